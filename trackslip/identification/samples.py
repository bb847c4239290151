"""Steady slip samples from runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackslip.errors import InvalidValueError, LogError, require_non_negative
from trackslip.identification.plausibility import require_plausible
from trackslip.kinematics import Array, RobotGeometry, curvature, track_slip
from trackslip.logs.runlog import RunLog
from trackslip.motion.methods import MOTION_METHODS, best_method
from trackslip.motion.stationarity import require_steady_motion
from trackslip.motion.steady import SETTLE, steady_part


@dataclass(frozen=True)
class SlipSamples:
    """Mean slip of steady runs, one row per run."""

    omega: Array  # (n, 2) measured sprocket speeds [rad/s]
    twist: Array  # (n, 2) [m/s, rad/s]
    slip: Array  # (n, 2)
    run: tuple[str, ...]  # (n,) names
    covariance: Array | None = None  # (n, 2, 2) of the errors of the twists, if known

    def __len__(self) -> int:
        return len(self.run)

    @property
    def curvature(self) -> Array:
        """Curvatures (n,) of the observed paths [1/m]."""
        return curvature(self.twist)

    @property
    def radius(self) -> Array:
        """Signed radii (n,) of the observed paths [m]; infinite for a straight one."""
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
    ) -> SlipSamples:
        """Samples from steady sprocket speeds and twists (n, 2), with covariances (n, 2, 2) if known; Eqs. 2-3.

        Raises:
            LogError: if a sprocket stands still, so that its slip is undefined, or a slip is implausible.
        """
        slip = track_slip(omega, twist, geometry)
        require_plausible(omega, twist, slip, geometry, run)
        return cls(omega, twist, slip, tuple(run), covariance)

    @classmethod
    def joined(cls, parts: Sequence[SlipSamples]) -> SlipSamples:
        """Concatenate samples."""
        return cls(
            omega=np.concatenate([part.omega for part in parts]),
            twist=np.concatenate([part.twist for part in parts]),
            slip=np.concatenate([part.slip for part in parts]),
            run=tuple(name for part in parts for name in part.run),
            covariance=None
            if any(part.covariance is None for part in parts)
            else np.concatenate([part.covariance for part in parts if part.covariance is not None]),
        )

    def take(self, rows: np.ndarray) -> SlipSamples:
        """The samples `rows`."""
        kept = np.arange(len(self))[rows]
        return SlipSamples(
            self.omega[kept],
            self.twist[kept],
            self.slip[kept],
            tuple(self.run[k] for k in kept),
            None if self.covariance is None else self.covariance[kept],
        )


@dataclass(frozen=True)
class Refused:
    """A run that gave no sample or was excluded from the fits."""

    run: str
    """Name of the run."""
    reason: str
    """Why it was excluded."""

    def __str__(self) -> str:
        return f"run {self.run!r} left out: {self.reason}"


@dataclass(frozen=True)
class Sampling:
    """The samples of a set of runs, and why some runs gave none."""

    samples: SlipSamples
    """One sample per usable run."""
    refused: tuple[Refused, ...]
    """Runs without a sample."""
    notes: tuple[str, ...]
    """What was excluded from usable runs, one line each."""


def slip_samples(
    logs: Sequence[RunLog], geometry: RobotGeometry, settle: float = SETTLE, method: str | None = None
) -> SlipSamples:
    """Mean slip of each run from its estimated poses and measured sprocket speeds.

    Args:
        logs: runs with a stretch at constant sprocket speeds.
        geometry: the robot's nominal geometry.
        settle: time excluded after the sprockets have become steady [s].
        method: name of a method in MOTION_METHODS; by default the most accurate that each run allows.

    Raises:
        InvalidValueError: if the method is unknown.
        LogError: if a run has no steady stretch, or too few valid poses in it.
    """
    return SlipSamples.joined([_sample(log, geometry, settle, method)[0] for log in logs])


def usable_samples(
    logs: Sequence[RunLog], geometry: RobotGeometry, settle: float = SETTLE, method: str | None = None
) -> Sampling:
    """The samples of all usable runs, and why the others give none; see `slip_samples`.

    Raises:
        InvalidValueError: if the method is unknown.
        LogError: if no run is usable.
    """
    usable: list[SlipSamples] = []
    refused: list[Refused] = []
    notes: list[str] = []
    for log in logs:
        try:
            sample, noted = _sample(log, geometry, settle, method)
        except LogError as error:
            refused.append(Refused(log.run, str(error).removeprefix(f"run {log.run!r}: ")))
            continue
        usable.append(sample)
        notes += noted
    return _sampling(usable, refused, notes)


def usable_rows(omega: Array, twist: Array, geometry: RobotGeometry) -> Sampling:
    """Samples from steady sprocket speeds and twists (n, 2), called row 1, row 2, ..., as far as they are usable.

    Raises:
        LogError: if no run is usable.
    """
    usable, refused = [], []
    for k in range(len(omega)):
        name = f"row {k + 1}"
        try:
            usable.append(SlipSamples.of(omega[k : k + 1], twist[k : k + 1], geometry, [name]))
        except LogError as error:
            refused.append(Refused(name, str(error).removeprefix(f"run {name!r}: ")))
    return _sampling(usable, refused, [])


def _sampling(usable: list[SlipSamples], refused: list[Refused], notes: list[str]) -> Sampling:
    if not usable:
        every = f"none of the {len(refused)} runs can be used; " if len(refused) > 1 else ""
        raise LogError(f"{every}run {refused[0].run!r}: {refused[0].reason}")
    return Sampling(SlipSamples.joined(usable), tuple(refused), tuple(notes))


def _sample(
    log: RunLog, geometry: RobotGeometry, settle: float, method: str | None
) -> tuple[SlipSamples, tuple[str, ...]]:
    """The sample of a run, and notes on what was excluded from the run."""
    require_non_negative("settle", settle)
    method = method or best_method(log)
    if method not in MOTION_METHODS:
        raise InvalidValueError("motion", method, f"one of {', '.join(MOTION_METHODS)}")
    part = steady_part(log, geometry, settle)
    require_steady_motion(part)
    omega = part.log.omega[part.rows].mean(axis=0)
    steady = MOTION_METHODS[method](part.log, part.window)
    sample = SlipSamples.of(omega[None], steady.twist[None], geometry, [log.run], steady.covariance[None])
    return sample, part.notes


def true_samples(
    logs: Sequence[RunLog], geometry: RobotGeometry, settle: float = SETTLE, of_plate: bool = False
) -> SlipSamples:
    """Samples from the true motion of simulated runs.

    Args:
        logs: simulated runs.
        geometry: the robot's nominal geometry.
        settle: time excluded after the sprockets have become steady [s].
        of_plate: use the motion of the scanned plate, which leans outwards with the robot: it moves along a wider
            circle, faster by the yaw rate times the lean.

    Raises:
        LogError: if a run has no truth.
    """
    omega, twist = [], []
    for log in logs:
        if log.truth is None or (of_plate and log.truth.lean is None):
            raise LogError(f"run {log.run!r}: has no truth")
        rows = steady_part(log, geometry, settle).rows
        true = log.truth.twist[rows][:, [0, 2]]
        if of_plate and log.truth.lean is not None:
            true = np.column_stack([true[:, 0] - true[:, 1] * log.truth.lean[rows], true[:, 1]])
        omega.append(log.omega[rows].mean(axis=0))
        twist.append(true.mean(axis=0))
    return SlipSamples.of(np.array(omega), np.array(twist), geometry, [log.run for log in logs])
