"""Steady slip samples from runs."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from trackslip.errors import InvalidValueError, LogError, require_non_negative
from trackslip.identification.plausibility import NEARLY_STANDING, require_plausible
from trackslip.kinematics import Array, RobotGeometry, curvature, track_slip
from trackslip.logs.refused import Refused, none_usable
from trackslip.logs.runlog import RunLog
from trackslip.motion.constant_speed import SETTLE
from trackslip.motion.load_pieces import load_pieces
from trackslip.motion.methods import MOTION_METHODS, best_method
from trackslip.motion.steady import MARGIN, STANDING, SteadyPart, require_steady_motion, steady_part, steady_parts

_OPTIONAL = ("covariance", "lateral", "lateral_stderr", "load")  # fields of SlipSamples


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
    load: Array | None = None  # (n, 2) mean tractions per unit load, along and to the left, if known [-]

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
        load: Array | None = None,
    ) -> SlipSamples:
        """Samples from steady sprocket speeds and twists (n, 2); Eqs. 2-3.

        With covariances (n, 2, 2) of the twists, lateral speeds (n,), their standard errors (n,) and tractions per
        unit load (n, 2) if known.

        The slip of a track whose sprocket stands, or nearly so, is undefined: NaN. Raises LogError if both stand or the
        motion is implausible.
        """
        size = np.abs(omega)
        standing = size < NEARLY_STANDING * size.max(axis=1, keepdims=True)
        slip = np.where(standing, np.nan, track_slip(omega, twist, geometry))
        yaw_stderr = np.zeros(len(twist)) if covariance is None else np.sqrt(np.maximum(covariance[:, 1, 1], 0.0))
        require_plausible(omega, twist, slip, geometry, run, yaw_stderr)
        return cls(omega, twist, slip, tuple(run), covariance, lateral, lateral_stderr, load)

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
class MeasuredRun:
    """What was found of the longest steady stretch of a run."""

    window: tuple[float, float]
    """Start and end [s]."""
    notes: tuple[str, ...]
    """What was excluded from the run besides settling, one line each."""
    by_method: Mapping[str, SlipSamples]
    """Method -> sample, as `part_by_method` finds it."""
    truth: SlipSamples | None
    """The sample from the true motion, if that is known."""


MeasuredRuns = Mapping[str, MeasuredRun]
"""By the name of the run."""


@dataclass(frozen=True)
class Sampling:
    """The samples of a set of runs, and why some runs or stretches gave none."""

    samples: SlipSamples
    """One sample per usable stretch."""
    refused: tuple[Refused, ...]
    """Runs and steady stretches without a sample."""
    notes: tuple[str, ...]
    """What was excluded from usable runs, one line each."""
    steady_share: float = 1.0
    """Share of the time of driving that is in steady stretches, settling included [-]."""


def slip_samples(
    logs: Sequence[RunLog], geometry: RobotGeometry, settle: float = SETTLE, method: str | None = None
) -> SlipSamples:
    """Mean slip of each run from its poses and sprocket speeds, in its longest stretch of constant sprocket speeds.

    The first `settle` [s] of the stretch are left out. The method is one of MOTION_METHODS, by default the most
    accurate that each run allows. Raises LogError if a run has no steady stretch, or too few valid poses in it.
    """
    _require_known(settle, method)
    return SlipSamples.joined([_sample(steady_part(log, geometry, settle), geometry, method) for log in logs])


def steadily_driven(log: RunLog, geometry: RobotGeometry, settle: float = SETTLE) -> SteadyPart:
    """The longest steady stretch of a run; raises LogError if it has none, or moves unsteadily in it."""
    part = steady_part(log, geometry, settle)
    require_steady_motion(part)
    return part


def part_by_method(
    part: SteadyPart, geometry: RobotGeometry, methods: Iterable[str] = tuple(MOTION_METHODS)
) -> dict[str, SlipSamples]:
    """The sample of a steady stretch by each of the methods that it allows."""
    found = {}
    for name in methods:
        with contextlib.suppress(LogError):
            found[name] = _measured(part, geometry, name)
    return found


def usable_samples(
    logs: Sequence[RunLog],
    geometry: RobotGeometry,
    settle: float = SETTLE,
    method: str | None = None,
    refused: Sequence[Refused] = (),
    longest: bool = False,
    measured: MeasuredRuns = MappingProxyType({}),
) -> Sampling:
    """The samples of all steady stretches of all runs, and why others give none; LogError if none is usable.

    A run with several stretches gives as many samples, named by when they begin; with `longest`, only the longest
    stretch of each run counts, as in `slip_samples`, and runs may be `measured` already. `refused` are runs that were
    left out before.
    """
    _require_known(settle, method)
    found = _Found(list(refused))
    stretches = _longest_only if longest else steady_parts
    for log in logs:
        known = measured.get(log.run) if longest else None
        if known is not None and (sample := known.by_method.get(method or best_method(log))) is not None:
            found.usable.append(sample)
            found.steady += known.window[1] - known.window[0] + max(settle, MARGIN) + MARGIN
            found.notes += known.notes
            continue
        try:
            parts = stretches(log, geometry, settle)
        except LogError as error:
            found.refused.append(Refused.of(log.run, error))
            continue
        before = len(found.usable)
        for part in parts:
            pieces = (part,) if longest else load_pieces(part)
            lead, trail = max(settle, MARGIN) / len(pieces), MARGIN / len(pieces)
            for piece in pieces:
                try:
                    found.usable.append(_sample(piece, geometry, method))
                    found.steady += piece.window[1] - piece.window[0] + lead + trail
                except LogError as error:
                    found.refused.append(Refused(piece.name, Refused.of(log.run, error).reason))
        found.notes += parts[0].notes if len(found.usable) > before else ()
    return found.sampling(sum(_moving_time(log) for log in logs))


def _moving_time(log: RunLog) -> float:
    """Time in which a sprocket turns [s]."""
    return float(np.diff(log.time)[np.abs(log.omega[1:]).max(axis=1) > STANDING].sum())


def usable_rows(
    omega: Array, twist: Array, geometry: RobotGeometry, unread: Mapping[int, str] = MappingProxyType({})
) -> Sampling:
    """The usable samples of steady sprocket speeds and twists (n, 2), named row 1, row 2, ...; LogError if none is.

    `unread` are rows that cannot be read, with the reason.
    """
    found = _Found([])
    for k in range(len(omega)):
        name = f"row {k + 1}"
        try:
            if k in unread:
                raise LogError(unread[k])
            found.usable.append(SlipSamples.of(omega[[k]], twist[[k]], geometry, [name]))
        except LogError as error:
            found.refused.append(Refused.of(name, error))
    return found.sampling()


def _longest_only(log: RunLog, geometry: RobotGeometry, settle: float) -> tuple[SteadyPart, ...]:
    return (steady_part(log, geometry, settle),)


@dataclass
class _Found:
    """Samples found so far."""

    refused: list[Refused]
    usable: list[SlipSamples] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    steady: float = 0.0  # time in the stretches used [s]

    def sampling(self, moving: float = 0.0) -> Sampling:
        """All of them, out of a time of driving [s]; raises LogError if there is no sample."""
        if not self.usable:
            raise LogError(none_usable(self.refused))
        share = min(1.0, self.steady / moving) if moving > 0 else 1.0
        return Sampling(SlipSamples.joined(self.usable), tuple(self.refused), tuple(self.notes), share)


def _require_known(settle: float, method: str | None) -> None:
    """Raise InvalidValueError for an invalid option."""
    require_non_negative("settle", settle)
    if method is not None and method not in MOTION_METHODS:
        raise InvalidValueError("motion", method, f"one of {', '.join(MOTION_METHODS)}")


def _sample(part: SteadyPart, geometry: RobotGeometry, method: str | None) -> SlipSamples:
    """The sample of a steady stretch; raises LogError if the robot moves unsteadily in it."""
    require_steady_motion(part)
    return _measured(part, geometry, method)


def _measured(part: SteadyPart, geometry: RobotGeometry, method: str | None) -> SlipSamples:
    """The sample of a steady stretch."""
    steady = MOTION_METHODS[method or best_method(part.log)](part.log, part.window)
    lateral = None if steady.lateral is None else np.array([steady.lateral])
    lateral_stderr = None if steady.lateral_stderr is None else np.array([steady.lateral_stderr])
    return SlipSamples.of(
        part.omega[None],
        steady.twist[None],
        geometry,
        [part.name],
        steady.covariance[None],
        lateral,
        lateral_stderr,
        None if part.load is None else part.load[None],
    )
