"""Steady slip samples from runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from trackslip.errors import InvalidValueError, LogError, require_non_negative
from trackslip.identification.plausibility import require_plausible
from trackslip.kinematics import Array, RobotGeometry, curvature, track_slip
from trackslip.logs.refused import Refused
from trackslip.logs.runlog import RunLog
from trackslip.motion.methods import MOTION_METHODS, best_method
from trackslip.motion.steady import SETTLE, require_steady_motion, steady_part

_OPTIONAL = ("covariance", "lateral", "lateral_stderr")  # fields of SlipSamples


@dataclass(frozen=True)
class SlipSamples:
    """Mean slip of steady runs, one row per run."""

    omega: Array  # (n, 2) measured sprocket speeds [rad/s]
    twist: Array  # (n, 2) [m/s, rad/s]
    slip: Array  # (n, 2)
    run: tuple[str, ...]  # (n,) names
    covariance: Array | None = None  # (n, 2, 2) of the errors of the twists, if known
    lateral: Array | None = None  # (n,) speed to the left in the frame of the measured heading, if measured [m/s]
    lateral_stderr: Array | None = None  # (n,) its standard errors [m/s]

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
        lateral: Array | None = None,
        lateral_stderr: Array | None = None,
    ) -> SlipSamples:
        """Samples from steady sprocket speeds and twists (n, 2); Eqs. 2-3.

        With covariances (n, 2, 2) of the twists, lateral speeds (n,) and their standard errors (n,) if known.

        Raises LogError if a sprocket stands still, so that its slip is undefined, or a slip is implausible.
        """
        slip = track_slip(omega, twist, geometry)
        require_plausible(omega, twist, slip, geometry, run)
        return cls(omega, twist, slip, tuple(run), covariance, lateral, lateral_stderr)

    @classmethod
    def joined(cls, parts: Sequence[SlipSamples]) -> SlipSamples:
        """Concatenate samples."""

        def known(name: str) -> Array | None:
            values = [value for part in parts if (value := getattr(part, name)) is not None]
            return np.concatenate(values) if len(values) == len(parts) else None

        return cls(
            omega=np.concatenate([part.omega for part in parts]),
            twist=np.concatenate([part.twist for part in parts]),
            slip=np.concatenate([part.slip for part in parts]),
            run=tuple(name for part in parts for name in part.run),
            **{name: known(name) for name in _OPTIONAL},
        )

    def take(self, rows: np.ndarray) -> SlipSamples:
        """The samples `rows`."""
        run = tuple(np.array(self.run, object)[rows])
        optional = {name: None if (values := getattr(self, name)) is None else values[rows] for name in _OPTIONAL}
        return SlipSamples(self.omega[rows], self.twist[rows], self.slip[rows], run, **optional)


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
    """Mean slip of each run from its poses and sprocket speeds, in its longest stretch of constant sprocket speeds.

    The first `settle` [s] of the stretch are left out. The method is one of MOTION_METHODS, by default the most
    accurate that each run allows. Raises LogError if a run has no steady stretch, or too few valid poses in it.
    """
    return SlipSamples.joined([_sample(log, geometry, settle, method)[0] for log in logs])


def usable_samples(
    logs: Sequence[RunLog], geometry: RobotGeometry, settle: float = SETTLE, method: str | None = None
) -> Sampling:
    """The samples of all usable runs, and why the others give none, like `slip_samples`; LogError if none is usable."""
    return _usable([log.run for log in logs], lambda k: _sample(logs[k], geometry, settle, method))


def usable_rows(omega: Array, twist: Array, geometry: RobotGeometry) -> Sampling:
    """The usable samples of steady sprocket speeds and twists (n, 2), named row 1, row 2, ...; LogError if none is."""
    names = [f"row {k + 1}" for k in range(len(omega))]
    return _usable(names, lambda k: (SlipSamples.of(omega[[k]], twist[[k]], geometry, names[k : k + 1]), ()))


def _usable(names: Sequence[str], sample_of: Callable[[int], tuple[SlipSamples, tuple[str, ...]]]) -> Sampling:
    """The samples of all runs for which `sample_of` raises no LogError."""
    usable: list[SlipSamples] = []
    refused: list[Refused] = []
    notes: list[str] = []
    for k, name in enumerate(names):
        try:
            sample, noted = sample_of(k)
        except LogError as error:
            refused.append(Refused(name, str(error).removeprefix(f"run {name!r}: ")))
        else:
            usable.append(sample)
            notes += noted
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
    lateral = None if steady.lateral is None else np.array([steady.lateral])
    lateral_stderr = None if steady.lateral_stderr is None else np.array([steady.lateral_stderr])
    sample = SlipSamples.of(
        omega[None], steady.twist[None], geometry, [log.run], steady.covariance[None], lateral, lateral_stderr
    )
    return sample, part.notes


def true_samples(
    logs: Sequence[RunLog], geometry: RobotGeometry, settle: float = SETTLE, of_plate: bool = False
) -> SlipSamples:
    """Samples from the true motion of simulated runs, like `slip_samples`; raises LogError if a run has no truth.

    `of_plate` takes the motion of the scanned plate, which leans outwards with the robot: it moves along a wider
    circle, faster by the yaw rate times the lean.
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
