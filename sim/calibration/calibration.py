"""Model parameters fitted to slips and radii, every evaluation driven by a fleet: all targets in one batch."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy

from sim.calibration.target import SLIP_SCALE, Target, TurnTable
from sim.drive.drive import Drive, tireless
from sim.fleet import Fleet
from sim.ground.ground import Ground
from sim.robot.parameters import RobotParameters
from sim.robot.robot import Robot, load_robot
from sim.runs import Progress
from trackslip.errors import InvalidValueError
from trackslip.kinematics import Array, RobotGeometry
from trackslip.skid_theory import line_contact, steady_twist

_STEADY = 2.0  # time after which the robots drive steadily [s]
_STEP = 0.005  # of a parameter in finite differences, relative to the width of its bounds
_TOLERANCE = 1e-4  # of the parameters and the cost at the optimum, relative
_SILENT = 1e-2  # effect of a parameter that has none, relative to that of the strongest
_COLLINEAR = 100.0  # condition index from which parameters trade off against each other
_PART = 0.3  # of a parameter in such a direction of unit length
NUMERICAL_ERROR = 2e-5
"""Slip by which the simulator itself is uncertain [-]: standard errors are at least what it leads to."""


@dataclass(frozen=True)
class Candidate:
    """A robot on a ground, of which slip sees the ratio of friction only."""

    robot: RobotParameters
    friction_ratio: float
    """Friction across over friction along [-]."""

    @property
    def geometry(self) -> RobotGeometry:
        """For the kinematics."""
        return RobotGeometry(self.robot.half_gauge, self.robot.sprocket_radius)

    def with_values(self, values: Mapping[str, float]) -> Candidate:
        """Another candidate, with some parameters changed by name."""
        changed = dict(values)
        ratio = changed.pop("friction_ratio", self.friction_ratio)
        return Candidate(replace(self.robot, **changed), ratio)

    def value(self, name: str) -> float:
        """Of a parameter by name."""
        return self.friction_ratio if name == "friction_ratio" else float(getattr(self.robot, name))


TwistOf = Callable[[Candidate, Target], Array]
"""Candidate and target -> steady twists (M, 2)."""


def bounds(base: Candidate) -> dict[str, tuple[float, float]]:
    """What can be free, and between which values."""
    robot = base.robot
    return {
        "half_gauge": (0.6 * robot.half_gauge, 1.6 * robot.half_gauge),
        "contact_length": (0.7 * robot.contact_length, 1.5 * robot.contact_length),
        "friction_ratio": (0.4, 2.5),
        "radius_error": (-0.2, 0.2),
        "com_x": (-0.06 * robot.contact_length, 0.06 * robot.contact_length),
        "com_y": (-0.25 * robot.half_gauge, 0.25 * robot.half_gauge),
    }


def simulated_twist(candidate: Candidate, target: Target, along: float = Ground().along, threads: int = 0) -> Array:
    """Steady twists (M, 2) of a candidate, simulated, at a target's sprocket speeds."""
    robot = _compiled(replace(candidate.robot, radius_error=0.0))
    omega = target.omega(candidate.geometry)
    drive = tireless(max(Drive.top_speed, 1.01 * float(np.abs(omega).max()) * candidate.robot.sprocket_radius))
    ground = Ground(along, along * candidate.friction_ratio)
    fleet = Fleet(robot, np.zeros((len(omega), 3)), ground, candidate.robot.radius_error, drive, threads)
    fleet.command(omega)
    fleet.advance(_STEADY)
    v, _, w = fleet.twist().T
    if target.of_plate:  # the robot leans to one side, and so does the plate
        offset, heading = fleet.plate[:, :2] - fleet.pose()[:, :2], fleet.pose()[:, 2]
        v = v - w * (np.cos(heading) * offset[:, 1] - np.sin(heading) * offset[:, 0])
    return np.stack([v, w], axis=-1)


@lru_cache(maxsize=16)
def _compiled(parameters: RobotParameters) -> Robot:
    return load_robot(parameters=parameters)


def theoretical_twist(candidate: Candidate, target: Target) -> Array:
    """The same by theory, without simulating."""
    robot = candidate.robot
    contact = line_contact(
        robot.half_gauge,
        robot.contact_length / 2,
        1.0,
        candidate.friction_ratio,
        (robot.com_x, robot.com_y, robot.com_height),
        points=20,
    )
    surface = target.omega(candidate.geometry) * robot.sprocket_radius * (1 + robot.radius_error)
    return steady_twist(surface, contact, 9.81)[:, [0, 2]]


@dataclass(frozen=True)
class Fit:
    """The best candidate for a target."""

    candidate: Candidate
    free: tuple[str, ...]
    stderr: dict[str, float]
    """Standard error of each parameter that is identifiable, from the scatter about the fit."""
    tied: tuple[str, ...]
    """Parameters that the target doesn't determine one by one."""
    slip_rms: float
    radius_rms: float | None
    """Relative; None for a target without radii."""
    ends: tuple[tuple[Candidate, float], ...]
    """Where each start ended, the best first, with its sum of squared weighted residuals."""


def starts(free: Sequence[str], count: int, generator: np.random.Generator) -> Array:
    """Random starts (count, len(free)), from 0 to 1 between the bounds but not at them."""
    return generator.uniform(0.1, 0.9, (count, len(free)))


def calibrate(
    base: Candidate,
    free: Sequence[str],
    target: Target,
    twist: TwistOf,
    further: Array,
    progress: Progress = lambda starts: None,
) -> Fit:
    """Fit the parameters `free` of a candidate to a target.

    Args:
        base: the first start, and the values of what isn't free.
        free: names out of `bounds`.
        target: what to come near to.
        twist: `simulated_twist` or `theoretical_twist`.
        further: starts (S, len(free)) besides, from 0 to 1 between the bounds.
        progress: called with 1 after each start.

    Raises:
        InvalidValueError: for a name that can't be free, one that is there twice, or too many for the target.
    """
    limits = bounds(base)
    for name in free:
        if name not in limits:
            raise InvalidValueError("free", name, f"one of {', '.join(limits)}")
        if list(free).count(name) > 1:
            raise InvalidValueError("free", name, "named once")
    if not 0 < len(free) < target.independent:
        raise InvalidValueError("free", list(free), f"one to {target.independent - 1} parameters for this target")
    problem = _Problem(base, tuple(free), target, twist, limits)
    first = problem.scaled(base)
    tied, held = undetermined(problem.jacobian(first))
    # what is held is held at the same place for every start: the target doesn't say where
    ends = []
    for start in (first, *further):
        ends.append(problem.minimum(np.where(held, first, start), held))
        progress(1)
    return problem.described(sorted(ends, key=lambda end: end[1]), tied, held)


def floor(fit: Fit, target: Target) -> Fit:
    """The nearest that quasi-static Coulomb theory comes to the slips of a target with the free parameters of a fit."""
    if isinstance(target, TurnTable):
        target = replace(target, radius_scale=np.inf)
    return calibrate(fit.candidate, fit.free, target, theoretical_twist, np.empty((0, len(fit.free))))


def undetermined(jacobian: Array) -> tuple[np.ndarray, np.ndarray]:
    """Which parameters (k,) residuals with this Jacobian (n, k) don't determine, and which to hold for the rest's sake.

    A parameter that changes nothing, and those of a direction in which several cancel each other: where the condition
    index of the Jacobian with columns of unit length is large (Belsley, Kuh and Welsch 1980). Of each such direction
    the last parameter is held.
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
    """The residuals as a function of scaled parameters: 0 at the lower bound, 1 at the upper."""

    def __init__(
        self,
        base: Candidate,
        free: tuple[str, ...],
        target: Target,
        twist: TwistOf,
        limits: Mapping[str, tuple[float, float]],
    ) -> None:
        self._base, self._free, self._target, self._twist = base, free, target, twist
        self._low, self._high = np.array([limits[name] for name in free]).T

    def scaled(self, candidate: Candidate) -> Array:
        """The parameters (k,) of a candidate."""
        values = np.array([candidate.value(name) for name in self._free])
        return np.clip((values - self._low) / (self._high - self._low), 0.0, 1.0)

    def candidate(self, scaled: Array) -> Candidate:
        """The candidate with these parameters (k,)."""
        values = self._low + scaled * (self._high - self._low)
        return self._base.with_values(dict(zip(self._free, map(float, values), strict=True)))

    def residual(self, scaled: Array) -> Array:
        """(n,)"""
        candidate = self.candidate(scaled)
        return self._target.residual(self._twist(candidate, self._target), candidate.geometry)

    def jacobian(self, scaled: Array) -> Array:
        """(n, k), by central differences inside the bounds."""
        columns = []
        for step in _STEP * np.eye(len(scaled)):
            above, below = np.minimum(scaled + step, 1.0), np.maximum(scaled - step, 0.0)
            columns.append((self.residual(above) - self.residual(below)) / np.sum(above - below))
        return np.stack(columns, axis=-1)

    def minimum(self, start: Array, held: np.ndarray) -> tuple[Array, float]:
        """The least squares nearest `start` (k,): parameters (k,) and the sum."""

        def inserted(varied: Array) -> Array:
            full = start.copy()
            full[~held] = varied
            return full

        if held.all():
            return start, float(np.sum(self.residual(start) ** 2))
        result = scipy.optimize.least_squares(
            lambda varied: self.residual(inserted(varied)),
            start[~held],
            bounds=(0.0, 1.0),
            diff_step=_STEP,
            xtol=_TOLERANCE,
            ftol=_TOLERANCE,
        )
        return inserted(result.x), 2 * float(result.cost)

    def described(self, ends: Sequence[tuple[Array, float]], tied: np.ndarray, held: np.ndarray) -> Fit:
        """The best of the minima that were found, first among `ends`, as a Fit."""
        best = ends[0][0]
        candidate = self.candidate(best)
        twist = self._twist(candidate, self._target)
        residual = self._target.residual(twist, candidate.geometry)
        cost = float(residual @ residual)
        degrees = self._target.independent - int((~held).sum())
        variance = max(cost / degrees, (NUMERICAL_ERROR / SLIP_SCALE) ** 2)
        jacobian = self.jacobian(best)[:, ~held]
        stderr = np.full(len(best), np.nan)
        stderr[~held] = np.sqrt(np.diag(np.linalg.pinv(jacobian.T @ jacobian)) * variance)
        stderr *= self._high - self._low
        return Fit(
            candidate=candidate,
            free=self._free,
            stderr={name: float(e) for name, e, t in zip(self._free, stderr, tied, strict=True) if not t},
            tied=tuple(name for name, t in zip(self._free, tied, strict=True) if t),
            slip_rms=self._target.slip_rms(twist, candidate.geometry),
            radius_rms=self._target.radius_rms(twist, candidate.geometry),
            ends=tuple((self.candidate(scaled), cost) for scaled, cost in ends),
        )
