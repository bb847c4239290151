"""Calibration: robot parameters fitted to slips and radii, all turns of an evaluation simulated in one batch."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from sim.calibration.target import SLIP_SCALE, Target, TurnTable
from sim.drive.drive import Drive, tireless
from sim.fleet import Fleet
from sim.ground.ground import Ground
from sim.loop import Progress
from sim.robot.parameters import RobotParameters
from sim.robot.robot import compiled
from trackslip import se2
from trackslip.errors import require
from trackslip.kinematics import Array, RobotGeometry
from trackslip.skid_theory import steady_twist

_STEADY = 2.0  # time until the motion is steady [s]
_PASSES, _LONGEST = 2.0, 12.0  # on ground that shears: contact lengths of the slowest belt; but no longer than [s]
_MAX_SHEAR = 0.05  # [m]
_FIRST_SHEAR = 0.005  # [m]
_STEP = 0.005  # of finite differences, relative to the width of a parameter's bounds
_TOLERANCE = 1e-4  # relative, of the parameters and the cost at the optimum
_SILENT = 1e-2  # sensitivity below which a parameter has no effect, relative to the largest
_COLLINEAR = 100.0  # condition index above which parameters can't be told apart
_PART = 0.3  # smallest component of a parameter that takes part in such a direction of unit length
_NUMERICAL_ERROR = 2e-5  # of simulated slips [-], a lower bound of the residuals that standard errors are based on


@dataclass(frozen=True)
class Candidate:
    """A robot on level ground, which affects slip by its friction ratio and shear modulus only."""

    robot: RobotParameters
    friction_ratio: float
    """Friction across over friction along [-]."""
    shear: float = 0.0
    """Shear modulus, 0 for Coulomb friction [m]."""

    @property
    def geometry(self) -> RobotGeometry:
        """Geometry for the kinematics."""
        return self.robot.geometry

    def with_values(self, values: Mapping[str, float]) -> Candidate:
        """A candidate with some parameters changed, by name."""
        changed: dict[str, Any] = {"friction_ratio": self.friction_ratio, "shear": self.shear, **values}
        ratio, shear = changed.pop("friction_ratio"), changed.pop("shear")
        return Candidate(replace(self.robot, **changed), ratio, shear)

    def value(self, name: str) -> float:
        """Value of a parameter, by name."""
        return float(getattr(self if name in ("friction_ratio", "shear") else self.robot, name))


TwistOf = Callable[[Candidate, Target], Array]
"""Candidate and target -> steady twists (M, 2)."""


def bounds(base: Candidate) -> dict[str, tuple[float, float]]:
    """Bounds of the parameters that can be fitted, by name."""
    gauge, length = base.robot.half_gauge, base.robot.contact_length
    return {
        "half_gauge": (0.6 * gauge, 1.6 * gauge),
        "contact_length": (0.7 * length, 1.5 * length),
        "friction_ratio": (0.4, 2.5),
        "shear": (0.0, _MAX_SHEAR),
        "radius_error": (-0.2, 0.2),
        "com_x": (-0.06 * length, 0.06 * length),
        "com_y": (-0.25 * gauge, 0.25 * gauge),
    }


def simulated_twist(candidate: Candidate, target: Target, along: float = Ground().along, threads: int = 0) -> Array:
    """Simulated steady twists (M, 2) of a candidate at a target's sprocket speeds [m/s, rad/s]."""
    robot = compiled(replace(candidate.robot, radius_error=0.0))
    omega = target.omega(candidate.geometry)
    drive = tireless(max(Drive.top_speed, 1.01 * float(np.abs(omega).max()) * candidate.robot.sprocket_radius))
    ground = Ground(along, along * candidate.friction_ratio, shear=candidate.shear)
    fleet = Fleet(robot, np.zeros((len(omega), 3)), ground, candidate.robot.radius_error, drive, threads)
    fleet.command(omega)
    fleet.advance(_time_to_be_steady(candidate, omega, fleet.period))
    v, _, w = fleet.twist().T
    if target.of_plate:  # the robot leans to one side, and so does the plate
        v = v - w * se2.between(fleet.pose(), fleet.plate)[:, 1]
    return np.stack([v, w], axis=-1)


def _time_to_be_steady(candidate: Candidate, omega: Array, period: float) -> float:
    """Settling time of turns at sprocket speeds `omega` (M, 2) [rad/s], in whole servo periods [s]."""
    moving = np.abs(omega[omega != 0]) * candidate.robot.sprocket_radius
    if candidate.shear == 0 or not moving.size:
        return _STEADY
    passed = _PASSES * candidate.robot.contact_length / float(moving.min())
    return round(min(_STEADY + passed, _LONGEST) / period) * period


def theoretical_twist(candidate: Candidate, target: Target) -> Array:
    """Theoretical steady twists (M, 2) of a candidate at a target's sprocket speeds [m/s, rad/s]."""
    robot, ratio = candidate.robot, candidate.friction_ratio
    contact = robot.contact_theory(1.0, ratio, points=20)
    surface = target.omega(candidate.geometry) * robot.sprocket_radius * (1 + robot.radius_error)
    return steady_twist(surface, contact, 9.81, candidate.shear)[:, [0, 2]]


@dataclass(frozen=True)
class Calibration:
    """The best candidate for a target."""

    candidate: Candidate
    """The candidate itself."""
    free: tuple[str, ...]
    """Names of the fitted parameters."""
    stderr: dict[str, float]
    """Standard error of each identifiable parameter, from the residuals."""
    correlation: dict[str, dict[str, float]]
    """Correlation of each identifiable parameter's error with the other parameters' [-]."""
    tied: tuple[str, ...]
    """Parameters that the target doesn't determine individually."""
    slip_rms: float
    """RMS error of the slips [-]."""
    radius_rms: float | None
    """RMS relative error of the radii [-]; None for a target without radii."""
    ends: tuple[tuple[Candidate, float], ...]
    """Optimum found from each start, with its sum of squared weighted residuals; the best first."""


def starts(free: Sequence[str], count: int, generator: np.random.Generator) -> Array:
    """Random starts (count, len(free)), scaled to the bounds: from 0.1 to 0.9."""
    return generator.uniform(0.1, 0.9, (count, len(free)))


def calibrate(
    base: Candidate,
    free: Sequence[str],
    target: Target,
    twist: TwistOf,
    further: Array,
    progress: Progress = lambda starts: None,
) -> Calibration:
    """Fit parameters to the turns of a target.

    Args:
        base: the first start, and the values of the other parameters.
        free: names of the parameters to fit, see `bounds`.
        target: the turns to reproduce.
        twist: `simulated_twist` or `theoretical_twist`.
        further: more starts (S, len(free)), scaled to the bounds: from 0 to 1.
        progress: called with 1 after each start.

    Raises:
        InvalidValueError: for an unknown name, a name given twice, or too many parameters for the target.
    """
    limits, most = bounds(base), target.independent - 1
    for name in free:
        require(name in limits, "free", name, f"one of {', '.join(limits)}")
        require(list(free).count(name) == 1, "free", name, "named once")
    require(0 < len(free) <= most, "free", list(free), f"one to {most} parameters for this target")
    if "shear" in free and base.shear == 0:  # at its bound, a fit to ground that shears might not leave it
        base = base.with_values({"shear": _FIRST_SHEAR})
    problem = _Problem(base, tuple(free), target, twist)
    first = problem.scaled(base)
    tied, held = undetermined(problem.jacobian(first))
    # parameters that the target doesn't determine are held at the same values for every start
    ends = []
    for start in (first, *further):
        ends.append(problem.minimum(np.where(held, first, start), held))
        progress(1)
    return problem.described(sorted(ends, key=lambda end: end[1]), tied, held)


def floor(fit: Calibration, target: Target) -> Calibration:
    """The best fit of quasi-static Coulomb theory to a target's slips, with the same free parameters as `fit`."""
    if isinstance(target, TurnTable):
        target = replace(target, radius_scale=np.inf)
    return calibrate(fit.candidate, fit.free, target, theoretical_twist, np.empty((0, len(fit.free))))


def undetermined(jacobian: Array) -> tuple[np.ndarray, np.ndarray]:
    """Parameters (k,) undetermined by residuals with this Jacobian (n, k), and the subset to hold fixed (k,).

    These are parameters without effect, and those that compensate each other: directions with a large condition index
    of the Jacobian with columns of unit length (Belsley, Kuh and Welsch 1980). The last parameter of each such
    direction is held.
    """
    length = np.linalg.norm(jacobian, axis=0)
    silent = length <= _SILENT * length.max()
    tied, held = silent.copy(), silent.copy()
    for _ in range(len(length)):
        left = np.flatnonzero(~held)
        _, singular, directions = np.linalg.svd(jacobian[:, left] / length[left], full_matrices=False)
        if singular[0] < _COLLINEAR * singular[-1]:
            break
        together = left[np.abs(directions[-1]) > _PART]
        tied[together] = True
        held[together[-1]] = True
    return tied, held


class _Problem:
    """The residuals as a function of scaled parameters, 0 at the lower bound and 1 at the upper one."""

    def __init__(self, base: Candidate, free: tuple[str, ...], target: Target, twist: TwistOf) -> None:
        self._base, self._free, self._target, self._twist = base, free, target, twist
        limits = bounds(base)
        self._low, self._high = np.array([limits[name] for name in free]).T

    def scaled(self, candidate: Candidate) -> Array:
        """Scaled parameters (k,) of a candidate."""
        values = np.array([candidate.value(name) for name in self._free])
        return np.clip((values - self._low) / (self._high - self._low), 0.0, 1.0)

    def candidate(self, scaled: Array) -> Candidate:
        """The candidate with scaled parameters (k,)."""
        values = self._low + scaled * (self._high - self._low)
        return self._base.with_values(dict(zip(self._free, map(float, values), strict=True)))

    def residual(self, scaled: Array) -> Array:
        """Residuals (n,)."""
        candidate = self.candidate(scaled)
        return self._target.residual(self._twist(candidate, self._target), candidate.geometry)

    def jacobian(self, scaled: Array) -> Array:
        """Jacobian (n, k) of the residuals, by central differences within the bounds."""
        columns = []
        for step in _STEP * np.eye(len(scaled)):
            above, below = np.minimum(scaled + step, 1.0), np.maximum(scaled - step, 0.0)
            columns.append((self.residual(above) - self.residual(below)) / np.sum(above - below))
        return np.stack(columns, axis=-1)

    def minimum(self, start: Array, held: np.ndarray) -> tuple[Array, float]:
        """Local minimum reached from `start` (k,): parameters (k,) and sum of squares."""

        def inserted(varied: Array) -> Array:
            full = start.copy()
            full[~held] = varied
            return full

        def residual(varied: Array) -> Array:
            return self.residual(inserted(varied))

        if held.all():
            return start, float(np.sum(self.residual(start) ** 2))
        options = {"bounds": (0.0, 1.0), "diff_step": _STEP, "xtol": _TOLERANCE, "ftol": _TOLERANCE}
        result = scipy.optimize.least_squares(residual, start[~held], **options)
        return inserted(result.x), 2 * float(result.cost)

    def described(self, ends: Sequence[tuple[Array, float]], tied: np.ndarray, held: np.ndarray) -> Calibration:
        """The best minimum, the first of `ends`, as a Calibration."""
        best = ends[0][0]
        candidate = self.candidate(best)
        twist = self._twist(candidate, self._target)
        residual = self._target.residual(twist, candidate.geometry)
        cost = float(residual @ residual)
        degrees = self._target.independent - int((~held).sum())
        variance = max(cost / degrees, (_NUMERICAL_ERROR / SLIP_SCALE) ** 2)
        jacobian = self.jacobian(best)[:, ~held]
        covariance = np.linalg.pinv(jacobian.T @ jacobian) * variance
        spread = np.sqrt(np.diag(covariance))
        stderr = spread * (self._high - self._low)[~held]
        correlation = covariance / np.maximum(np.outer(spread, spread), np.finfo(float).tiny)
        place = {name: k for k, name in enumerate(np.array(self._free)[~held].tolist())}
        known = [name for name, t in zip(self._free, tied, strict=True) if not t]
        return Calibration(
            candidate=candidate,
            free=self._free,
            stderr={name: float(stderr[place[name]]) for name in known},
            correlation={a: {b: float(correlation[place[a], place[b]]) for b in known if b != a} for a in known},
            tied=tuple(name for name, t in zip(self._free, tied, strict=True) if t),
            slip_rms=self._target.slip_rms(twist, candidate.geometry),
            radius_rms=self._target.radius_rms(twist),
            ends=tuple((self.candidate(scaled), cost) for scaled, cost in ends),
        )
