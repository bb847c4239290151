"""Steady slip samples: mean slip in stretches with constant sprocket speeds, from measured or true
motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from trackslip.errors import InvalidValueError, LogError, require_non_negative
from trackslip.kinematics import (
    Array,
    RobotGeometry,
    body_twist,
    curvature,
    track_slip,
    track_speeds,
)
from trackslip.logs.runlog import Refused, RunLog, none_usable
from trackslip.motion.arc import arc
from trackslip.motion.bundle import bundle
from trackslip.motion.steady import (
    MARGIN,
    SETTLE,
    STANDING,
    SteadyPart,
    load_pieces,
    require_steady_motion,
    steady_part,
    steady_parts,
)
from trackslip.motion.steady_twist import MotionMethod, paper
from trackslip.viewable import ShortRepr

MOTION_METHODS: Final[dict[str, MotionMethod]] = {"paper": paper, "arc": arc, "bundle": bundle}
"""Methods that estimate the twist of a steady run, from the paper's own to the most accurate."""
REPEATED: Final = 0.01
"""Largest angle between a command and its repeats (test_steady) [rad]."""
_FEWEST_FOR_YAW: Final = 4  # least number of runs that determine the sensor's yaw
_LEAST_YAW: Final = 0.02  # least yaw of a sensor that is corrected [rad]
_SIGNIFICANT: Final = 4.0  # least ratio of the yaw to its standard error
# ratio of singular values below which the runs don't determine the yaw and X
_LEAST_RATIO: Final = 0.1
# plausible ratios to the sprockets' speed and yaw rate (test_steady)
_KEPT: Final = np.array([[0.2, 0.0], [1.8, 1.8]])


@dataclass(frozen=True, repr=False)
class SlipSamples(ShortRepr):
    """Mean slip of steady runs, one row per run."""

    omega: Array  # (n, 2) measured sprocket speeds [rad/s]
    twist: Array  # (n, 2) mean twists [m/s, rad/s]
    slip: Array  # (n, 2) slip of the left and right track [-]
    run: tuple[str, ...]  # (n,) names
    covariance: Array | None = None  # (n, 2, 2) error covariances of the twists, if known
    # (n,) speed to the left of the measured heading, if measured [m/s]
    lateral: Array | None = None
    # (n, 2) mean tractions per unit load, forwards and to the left, if known [-]
    load: Array | None = None

    def __len__(self) -> int:
        return len(self.run)

    @property
    def curvature(self) -> Array:
        """Curvatures (n,) of the observed paths [1/m]."""
        return curvature(self.twist)

    @property
    def radius(self) -> Array:
        """Signed radii (n,) of the observed paths [m]; infinite for straight paths."""
        v, w = self.twist.T
        return np.divide(v, w, out=np.full(len(v), np.inf), where=w != 0)

    @classmethod
    def of(
        cls,
        omega: Array,
        twist: Array,
        geometry: RobotGeometry,
        run: Sequence[str],
        covariance: Array | None = None,
        lateral: Array | None = None,
        load: Array | None = None,
    ) -> SlipSamples:
        """Make samples from steady sprocket speeds, twists (n, 2) and any other known fields; Eqs.
        2-3.

        Slip is undefined (NaN) for a track whose sprocket hardly turns. Raises LogError if both
        sprockets stand still or the motion is implausible.
        """
        size = np.abs(omega)
        slip = np.where(
            size < 0.02 * size.max(axis=1, keepdims=True),
            np.nan,
            track_slip(omega, twist, geometry),
        )
        samples = cls(omega, twist, slip, tuple(run), covariance, lateral, load)
        _require_plausible(samples, geometry)
        return samples

    def arrays(self) -> dict[str, Array]:
        """The known fields except `run`, by name."""
        return {
            name: values
            for name, values in vars(self).items()
            if name != "run" and values is not None
        }

    @classmethod
    def joined(cls, parts: Sequence[SlipSamples]) -> SlipSamples:
        """Concatenate samples; a field that is missing in any part is left out."""
        arrays = [part.arrays() for part in parts]
        names = set.intersection(*map(set, arrays))
        run = tuple(name for part in parts for name in part.run)
        return cls(
            run=run, **{name: np.concatenate([part[name] for part in arrays]) for name in names}
        )

    def along_robot(self, geometry: RobotGeometry) -> SlipSamples:
        """Correct speeds for the sensor's yaw, if this is above 0.02 rad and significant, to be
        along the robot.

        A sensor with the yaw y, at X ahead of the turning centre, moves to its left at

            X w + v tan(y)

        The regression of the leftward speeds on v and b w yields tan(y). Where the runs don't
        determine both coefficients, the rank is 1.
        """
        if self.lateral is None or not np.isfinite(self.lateral).all():
            return self
        if len(self) < _FEWEST_FOR_YAW:
            return self

        # tan(y), and its standard error by the residuals
        columns = self.twist * [1.0, geometry.half_gauge]
        coefficients, squares, rank, _ = np.linalg.lstsq(columns, self.lateral, rcond=_LEAST_RATIO)
        tangent = coefficients[0]
        variance = squares.sum() / (len(self) - len(coefficients))
        inverse = np.linalg.pinv(columns.T @ columns)
        error = np.sqrt(variance * inverse[0, 0])
        if rank < 2 or abs(tangent) < max(_LEAST_YAW, _SIGNIFICANT * error):
            return self

        # the speeds, complex as forwards + i leftwards, turned back from the sensor to the robot
        of_sensor = self.twist[:, 0] + 1j * self.lateral
        of_robot = of_sensor * np.exp(-1j * np.arctan(tangent))
        return SlipSamples.of(
            self.omega,
            np.column_stack([of_robot.real, self.twist[:, 1]]),
            geometry,
            self.run,
            self.covariance,
            of_robot.imag,
            self.load,
        )

    def take(self, rows: np.ndarray) -> SlipSamples:
        """The samples in `rows`."""
        run = tuple(np.array(self.run, object)[rows])
        return SlipSamples(
            run=run, **{name: values[rows] for name, values in self.arrays().items()}
        )

    def relative_errors(self, twist: Array, geometry: RobotGeometry) -> Array:
        """Track speed errors (n, 2) of predicted twists (n, 2), relative to the belt speed of the
        faster sprocket.
        """
        missed = track_speeds(twist - self.twist, geometry.half_gauge)
        return missed / (geometry.sprocket_radius * np.abs(self.omega).max(axis=1, keepdims=True))

    def direction(self, geometry: RobotGeometry) -> Array:
        """Commanded directions (n,) in the plane (v, b w): 0 straight ahead, pi/2 for a left turn
        in place [rad].
        """
        commanded = body_twist(self.omega, 0.0, geometry)
        return np.asarray(np.arctan2(geometry.half_gauge * commanded[:, 1], commanded[:, 0]))

    def by_command(self, geometry: RobotGeometry) -> np.ndarray:
        """Ordered labels (n,), equal for runs with nearly the same ratio of sprocket speeds, hence
        path radius.
        """
        angle = self.direction(geometry)
        labels = np.zeros(len(angle), int)
        label = -1
        first = -np.inf  # angle of the first run with this label
        for k in np.argsort(angle):
            if angle[k] > first + REPEATED:
                label += 1
                first = angle[k]
            labels[k] = label
        return labels


def _require_plausible(samples: SlipSamples, geometry: RobotGeometry) -> None:
    """Raise LogError for a run with a motion unlike its sprockets', as from wrong units, signs,
    sides or gears.
    """
    plausible = are_plausible(samples.omega, samples.twist, geometry, samples.covariance)
    standing = np.asarray(~samples.omega.any(axis=1))
    for k in np.flatnonzero(standing | ~plausible)[:1].tolist():
        if standing[k]:
            raise LogError(f"run {samples.run[k]!r}: the sprockets stand still")
        contradiction = contradiction_of(samples.omega[k], samples.twist[k], geometry)
        raise LogError(f"run {samples.run[k]!r}: {contradiction}")


def are_plausible(
    omega: Array, twist: Array, geometry: RobotGeometry, covariance: Array | None = None
) -> np.ndarray:
    """(n,) bool: true for twists (n, 2), with any error covariances (n, 2, 2), that a robot may
    have at sprocket speeds (n, 2).

    A robot may lose much of its yaw rate, and its inner track may even be dragged forwards.
    """
    length = np.array([1.0, geometry.half_gauge])
    commanded = body_twist(omega, 0.0, geometry)
    along = length * np.where(commanded < 0, -twist, twist)  # (n, 2) [m/s]
    size = length * np.abs(commanded)
    variance = 0.0 if covariance is None else np.maximum(np.einsum("nkk->nk", covariance), 0.0)
    error = 4 * length * np.sqrt(variance)  # beyond chance
    plausible = (along >= _KEPT[0] * size - error) & (along <= _KEPT[1] * size + error)
    fastest = geometry.sprocket_radius * np.abs(omega).max(axis=1, keepdims=True)
    # where the sprockets differ or the sensor is off-centre
    plausible |= np.abs(along - size) <= 0.1 * fastest
    return np.asarray(plausible.all(axis=1))


def contradiction_of(omega: Array, twist: Array, geometry: RobotGeometry) -> str:
    """How a twist (2,) contradicts sprocket speeds (2,), and what to check."""
    moves, says = (
        f"{v:.3g} m/s and {w:+.3g} rad/s" for v, w in (twist, body_twist(omega, 0.0, geometry))
    )
    return (
        f"it moves at {moves}, but its sprockets say {says}: check the units (rad/s, m/s), "
        f"the gear, sprocket_radius = {geometry.sprocket_radius:g} m, left and right, and "
        "the signs"
    )


@dataclass(frozen=True, repr=False)
class Sampling(ShortRepr):
    """The samples from a set of runs, and the reasons why some runs or stretches yielded none."""

    samples: SlipSamples  # one sample per usable stretch
    refused: tuple[Refused, ...]  # runs and steady stretches without a sample
    notes: tuple[str, ...]  # excluded parts of usable runs, a line for each
    steady_share: float = 1.0  # steady stretches' share of the driving time, settling included [-]

    @classmethod
    def of(
        cls,
        usable: Sequence[SlipSamples],
        refused: Sequence[Refused],
        notes: Sequence[str] = (),
        share: float = 1.0,
    ) -> Sampling:
        """Join the usable samples into a sampling; raises LogError if there are none."""
        if not usable:
            raise LogError(none_usable(refused))
        return cls(SlipSamples.joined(usable), tuple(refused), tuple(notes), share)


def usable_samples(
    logs: Sequence[RunLog],
    geometry: RobotGeometry,
    settle: float = SETTLE,
    method: str | None = None,
    refused: Sequence[Refused] = (),
    longest: bool = False,
) -> Sampling:
    """Samples from the steady stretches of all runs, and the reasons why some stretches yield no
    sample.

    The first `settle` [s] of each stretch are left out. `refused` lists runs that were refused
    before. `method` is one of MOTION_METHODS, by default the most accurate that each run allows.
    With `longest`, only the longest stretch of each run is used; otherwise each stretch of a run
    yields a sample, which is named after the stretch's start time.

    Raises LogError if no run yields a sample, InvalidValueError for an invalid `settle` or
    `method`.
    """
    require_non_negative("settle", settle)
    if method is not None and method not in MOTION_METHODS:
        raise InvalidValueError("motion", method, f"one of {', '.join(MOTION_METHODS)}")
    usable = list[SlipSamples]()
    notes = list[str]()
    left_out = list(refused)
    steady = 0.0  # duration of steady stretches [s]
    for log in logs:
        try:
            parts = (steady_part(log, settle),) if longest else steady_parts(log, settle)
        except LogError as error:
            left_out.append(Refused.of(log.run, error))
            continue
        before = len(usable)
        for part in parts:
            pieces = (part,) if longest else load_pieces(part)
            for piece in pieces:
                try:
                    require_steady_motion(piece)
                    usable.append(
                        _sample(
                            piece,
                            geometry,
                            method or ("arc" if piece.log.scans is None else "bundle"),
                        )
                    )
                    steady += np.ptp(piece.window) + (max(settle, MARGIN) + MARGIN) / len(pieces)
                except LogError as error:
                    left_out.append(replace(Refused.of(log.run, error), run=piece.name))
        notes += parts[0].notes if len(usable) > before else ()
    turning = [np.abs(log.omega[1:]).max(axis=1) > STANDING for log in logs]
    moving = sum(
        float(np.diff(log.time)[rows].sum()) for log, rows in zip(logs, turning, strict=True)
    )
    return Sampling.of(usable, left_out, notes, min(1.0, steady / moving) if moving > 0 else 1.0)


def true_samples(
    logs: Sequence[RunLog], geometry: RobotGeometry, settle: float = SETTLE
) -> SlipSamples:
    """Samples from the true motion in the longest steady stretch of each simulated run.

    Raises LogError for a run without truth or without a steady stretch.
    """
    samples = []
    for log in logs:
        if log.truth is None:
            raise LogError(f"run {log.run!r}: has no truth")
        part = steady_part(log, settle)
        load = None if part.load is None else part.load[None]
        mean = log.truth.twist[part.rows][:, [0, 2]].mean(axis=0)[None]
        samples.append(SlipSamples.of(part.omega[None], mean, geometry, [part.name], load=load))
    return SlipSamples.joined(samples)


def _sample(part: SteadyPart, geometry: RobotGeometry, method: str) -> SlipSamples:
    """The sample from a steady stretch."""
    steady = MOTION_METHODS[method](part.log, part.window)
    lateral = None if steady.lateral is None else np.array([steady.lateral])
    load = None if part.load is None else part.load[None]
    return SlipSamples.of(
        part.omega[None],
        steady.twist[None],
        geometry,
        [part.name],
        steady.covariance[None],
        lateral,
        load,
    )
