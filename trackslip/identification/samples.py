"""Steady slip samples: mean slip in stretches of constant sprocket speeds, as measured and as truly driven."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from trackslip.errors import InvalidValueError, LogError, require_non_negative
from trackslip.identification.plausibility import NEARLY_STANDING, require_plausible
from trackslip.kinematics import Array, RobotGeometry, curvature, track_slip
from trackslip.logs.runlog import Refused, RunLog, none_usable
from trackslip.motion.constant_speed import SETTLE
from trackslip.motion.methods import MOTION_METHODS, best_method
from trackslip.motion.steady import (
    MARGIN,
    STANDING,
    SteadyPart,
    load_pieces,
    require_steady_motion,
    steady_part,
    steady_parts,
)

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
class Sampling:
    """The samples of a set of runs, and why some runs or stretches gave none."""

    samples: SlipSamples
    """One sample per usable stretch."""
    refused: tuple[Refused, ...]
    """Runs and steady stretches without a sample."""
    notes: tuple[str, ...]
    """Parts that were excluded from usable runs, one line each."""
    steady_share: float = 1.0
    """Share of the time of driving that is in steady stretches, settling included [-]."""


def usable_samples(
    logs: Sequence[RunLog],
    geometry: RobotGeometry,
    settle: float = SETTLE,
    method: str | None = None,
    refused: Sequence[Refused] = (),
    longest: bool = False,
) -> Sampling:
    """The samples of all steady stretches of all runs, and why others give none.

    Args:
        logs: runs.
        geometry: of the robot.
        settle: time at the start of each stretch that is left out [s].
        method: one of MOTION_METHODS; by default the most accurate that each run allows.
        refused: runs that were left out before.
        longest: whether only the longest stretch of each run counts; else a run with several stretches gives as many
            samples, named by when they begin.

    Raises:
        LogError: if no run gives a sample.
        InvalidValueError: for an invalid `settle` or `method`.
    """
    require_non_negative("settle", settle)
    if method is not None and method not in MOTION_METHODS:
        raise InvalidValueError("motion", method, f"one of {', '.join(MOTION_METHODS)}")
    usable: list[SlipSamples] = []
    notes: list[str] = []
    left_out, steady = list(refused), 0.0
    for log in logs:
        try:
            parts = (steady_part(log, geometry, settle),) if longest else steady_parts(log, geometry, settle)
        except LogError as error:
            left_out.append(Refused.of(log.run, error))
            continue
        before = len(usable)
        for part in parts:
            pieces = (part,) if longest else load_pieces(part)
            lead, trail = max(settle, MARGIN) / len(pieces), MARGIN / len(pieces)
            for piece in pieces:
                try:
                    require_steady_motion(piece)
                    usable.append(_sample(piece, geometry, method or best_method(piece.log)))
                    steady += piece.window[1] - piece.window[0] + lead + trail
                except LogError as error:
                    left_out.append(replace(Refused.of(log.run, error), run=piece.name))
        notes += parts[0].notes if len(usable) > before else ()
    moving = sum(_moving_time(log) for log in logs)
    return _sampling(usable, left_out, notes, min(1.0, steady / moving) if moving > 0 else 1.0)


def usable_rows(
    omega: Array,
    twist: Array,
    geometry: RobotGeometry,
    unread: Mapping[int, str] = MappingProxyType({}),
    lateral: Array | None = None,
) -> Sampling:
    """The usable samples of steady sprocket speeds and twists (n, 2), named row 1, row 2, ...; LogError if none is.

    `unread` are rows that cannot be read, with the reason; `lateral` (n,) are speeds to the left, NaN if unknown [m/s].
    """
    left_out, usable = list[Refused](), list[SlipSamples]()
    for k in range(len(omega)):
        name = f"row {k + 1}"
        try:
            if k in unread:
                raise LogError(unread[k])
            left = None if lateral is None else lateral[[k]]
            usable.append(SlipSamples.of(omega[[k]], twist[[k]], geometry, [name], lateral=left))
        except LogError as error:
            left_out.append(Refused.of(name, error))
    return _sampling(usable, left_out)


def true_samples(
    logs: Sequence[RunLog], geometry: RobotGeometry, settle: float = SETTLE, of_plate: bool = False
) -> SlipSamples:
    """Samples of the longest steady stretches from the true motion of simulated runs.

    `of_plate` takes the motion of the scanned plate, which leans outwards with the robot: it moves along a wider
    circle, faster by the yaw rate times the lean. Raises LogError if a run has no truth or no steady stretch.
    """
    found = []
    for log in logs:
        truth = log.truth
        if truth is None or (of_plate and truth.lean is None):
            raise LogError(f"run {log.run!r}: has no truth")
        part = steady_part(log, geometry, settle)
        twist = truth.twist[part.rows][:, [0, 2]]
        if of_plate and truth.lean is not None:
            twist = np.column_stack([twist[:, 0] - twist[:, 1] * truth.lean[part.rows], twist[:, 1]])
        load = None if part.load is None else part.load[None]
        mean = twist.mean(axis=0)[None]
        found.append(SlipSamples.of(part.omega[None], mean, geometry, [part.name], load=load))
    return SlipSamples.joined(found)


def _sample(part: SteadyPart, geometry: RobotGeometry, method: str) -> SlipSamples:
    """The sample of a steady stretch."""
    steady = MOTION_METHODS[method](part.log, part.window)
    return SlipSamples.of(
        part.omega[None],
        steady.twist[None],
        geometry,
        [part.name],
        steady.covariance[None],
        None if steady.lateral is None else np.array([steady.lateral]),
        None if steady.lateral_stderr is None else np.array([steady.lateral_stderr]),
        None if part.load is None else part.load[None],
    )


def _sampling(
    usable: Sequence[SlipSamples], left_out: Sequence[Refused], notes: Sequence[str] = (), share: float = 1.0
) -> Sampling:
    if not usable:
        raise LogError(none_usable(left_out))
    return Sampling(SlipSamples.joined(usable), tuple(left_out), tuple(notes), share)


def _moving_time(log: RunLog) -> float:
    """Time in which a sprocket turns [s]."""
    return float(np.diff(log.time)[np.abs(log.omega[1:]).max(axis=1) > STANDING].sum())
