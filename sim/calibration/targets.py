"""Calibration targets: data on a robot's motion, and the errors of a candidate that repeats it in
simulation.

There are three: the paper's table of turns (`PublishedTurns`), steady samples (`SteadyRows`) and
whole drives (`Drives`). A target gives n errors, simulated minus measured, and says in its `Layout`
what a fit must know about them: which have the same standard deviation, which tell the same and
share a weight, and which are independent of each other.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import Final, Protocol

import numpy as np

from sim.calibration.candidate import Candidate
from sim.fleet.fleet import Fleet
from sim.ground.ground import Ground
from sim.motors.motor import Drive, tireless
from sim.robot.parameters import RobotParameters
from sim.robot.robot import compiled
from sim.runs.log_replay import Inputs, Replay, Replayer, without_jumps
from trackslip import se2
from trackslip.errors import LogError
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import (
    Array,
    RobotGeometry,
    limit_sprocket_speeds,
    sprocket_speeds,
    track_slip,
)
from trackslip.laws.exponential import PUBLISHED
from trackslip.logs.runlog import RunLog
from trackslip.metrics import rms
from trackslip.paper import COMMANDED_RADII, OBSERVED_RADII, SPEEDS

SLIP_SCALE: Final = 0.007
"""Scale of slip errors in a table of turns, about the residual of the best fit to the published
slips [-].
"""
# scale of relative radius errors [-]: the best fit leaves 0.05, times the root of 2, as radii have
# half the weight
_RADIUS_SCALE: Final = 0.07
# of the paper's robot; faster commands are scaled down, both tracks alike [m/s]
_TOP_SPEED: Final = 0.3
_STEADY: Final = 2.0  # time after which the motion is steady [s]
# extra travel of the slowest belt on shearing ground until the motion is steady [contact lengths]
_PASSES: Final = 2.0
_LONGEST: Final = 12.0  # largest time until the motion counts as steady [s]
# error of the simulated motion, relative to slips, speeds and radii [-], or of poses [m, rad]
_NUMERICAL_ERROR: Final = 2e-5
HORIZONS: Final = (0.5, 1.0, 1.8, 5.0)
"""Horizons over which a drive is compared with its simulation [s]."""
_PAIRS: Final = 4.0  # approximate number of pose pairs that begin within a horizon
_MIN_DRIVEN: Final = 0.1  # belt travel above which a robot is moving [half gauges]
_WINDOW: Final = 6.5  # duration of the windows that are cut from drives [s]
# time replayed before a window, if the drive is long enough, to forget the initial state, even on
# ice [s]
_LEAD: Final = 3.0
_MAX_WINDOWS: Final = 200
_CACHED_MOTIONS: Final = 3
_ROBUST_FROM: Final = 20  # number of steady rows from which single wrong rows are evident
_ROUNDING: Final = 1e-9  # tolerance on times [s]


@dataclass(frozen=True)
class Layout:
    """Structure of a target's n errors."""

    # index of each error's kind (n,), from 0; all errors of a kind have one standard deviation
    kind: np.ndarray
    share: Array  # weight of each error (n,); errors with the same information share a weight of 1
    # index of each error's cluster (n,), from 0; different clusters are independent
    cluster: np.ndarray
    # smallest standard deviation per kind (kinds,), the numerical error of the simulation
    floor: Array
    robust: bool  # whether some errors may be very large

    @property
    def clusters(self) -> int:
        """Number of clusters."""
        return int(self.cluster.max()) + 1


@dataclass(frozen=True)
class Compared:
    """A quantity as it was measured and as a candidate simulates it."""

    name: str
    unit: str
    measured: Array  # (m,)
    simulated: Array  # (m,), NaN where the simulation has none


class Target(Protocol):
    """Data on a robot's motion: n measured numbers."""

    @property
    def layout(self) -> Layout:
        """Structure of the errors."""

    def errors(self, candidate: Candidate) -> Array:
        """Errors (n,) of a candidate, simulated minus measured."""

    def metrics(self, errors: Array) -> dict[str, float]:
        """Summary of errors (n,), without those that are NaN."""

    def compared(self, errors: Array) -> list[Compared]:
        """The measured quantities beside those of a candidate with these errors (n,)."""


# radii [m] and speeds [m/s] (2, M)
_COMMANDED: Final = np.array(list(itertools.product(COMMANDED_RADII, SPEEDS))).T
_OBSERVED: Final = np.repeat(OBSERVED_RADII, len(SPEEDS))  # radii (M,) [m]
Turns = Callable[..., Array]
"""Function that returns steady twists of a robot on a ground, such as `steady_turns`."""


@dataclass(frozen=True)
class PublishedTurns:
    """The paper's 25 left turns, whose commands are radii and speeds without slip compensation.

    Their slips, from Eq. 11 at the observed radii, refer to the nominal geometry of the robot being
    calibrated. Slips don't depend on speed, so the turns have the weight of only five, one for each
    radius.
    """

    threads: int = 0
    turns: Turns | None = None  # motion of candidates; by default simulated by `steady_turns`

    @cached_property
    def layout(self) -> Layout:
        """Structure of the errors: left and right slips, then radii."""
        turn = np.arange(len(_OBSERVED))
        cluster = np.concatenate([np.repeat(turn, 2), turn])
        count = len(cluster)
        # three errors, two slips and a radius, for each commanded radius
        weight = 3 * len(COMMANDED_RADII)
        return Layout(
            kind=np.zeros(count, int),
            share=np.full(count, weight / count),
            cluster=cluster,
            floor=np.array([_NUMERICAL_ERROR / SLIP_SCALE]),
            robust=False,
        )

    def errors(self, candidate: Candidate) -> Array:
        """Errors (n,) in the slips and in the logarithms of the radii, each divided by its
        scale.
        """
        radius, speed = _COMMANDED
        geometry = candidate.geometry
        commanded = np.stack([speed, speed / radius], axis=-1)
        wanted = sprocket_speeds(commanded, 0.0, geometry)
        omega = limit_sprocket_speeds(wanted, _TOP_SPEED / geometry.sprocket_radius)
        turns = self.turns or steady_turns
        twist = turns(candidate.robot, candidate.ground, omega, threads=self.threads)[:, [0, 2]]

        slip = track_slip(omega, twist, geometry) - PUBLISHED(1 / _OBSERVED)
        driven_radius = twist[:, 0] / twist[:, 1]
        slip_errors = slip / SLIP_SCALE
        radius_errors = np.log(driven_radius / _OBSERVED) / _RADIUS_SCALE
        return np.concatenate([slip_errors.ravel(), radius_errors])

    def metrics(self, errors: Array) -> dict[str, float]:
        """RMS errors in the slips, and RMS relative errors in the radii [-]."""
        slip, radius = np.split(errors, [2 * len(_OBSERVED)])
        slip = slip[np.isfinite(slip)] * SLIP_SCALE
        radius = np.expm1(radius[np.isfinite(radius)] * _RADIUS_SCALE)
        return {"slip_rms": rms(slip), "radius_rms": rms(radius)}

    def compared(self, errors: Array) -> list[Compared]:
        """The slips of the inner and the outer track [-] and the radii [m] of all turns."""
        slip, radius = np.split(errors, [2 * len(_OBSERVED)])
        inner, outer = PUBLISHED(1 / _OBSERVED).T  # the left track is the inner one
        inner_error, outer_error = SLIP_SCALE * slip.reshape(-1, 2).T
        driven = _OBSERVED * np.exp(_RADIUS_SCALE * radius)
        return [
            Compared("slip, inner track", "–", inner, inner + inner_error),
            Compared("slip, outer track", "–", outer, outer + outer_error),
            Compared("radius", "m", _OBSERVED, driven),
        ]


@dataclass(frozen=True)
class SteadyRows:
    """Steady samples of a real or simulated robot: sprocket speeds, and twists at the sensor."""

    samples: SlipSamples
    geometry: RobotGeometry  # geometry that defines the slips, for any candidate
    # whether the twists are those of the plate, as the scanner sees it, or of the tracks
    of_plate: bool = False
    threads: int = 0
    turns: Turns | None = None  # motion of candidates; by default simulated by `steady_turns`

    @cached_property
    def _measured(self) -> Array:
        """Measured speeds v and w, and lateral speeds if there are any (2 or 3, M); NaN where not
        measured.
        """
        v, w = self.samples.twist.T
        lateral = self.samples.lateral
        if lateral is None or not np.isfinite(lateral).any():
            return np.stack([v, w])
        return np.stack([v, w, lateral])

    @cached_property
    def _turns(self) -> Callable[[RobotParameters, Ground], Array]:
        """Steady twists (M, 3), cached for candidates that differ only in the sensor."""
        turns = self.turns or steady_turns

        @lru_cache(_CACHED_MOTIONS)
        def twists(robot: RobotParameters, ground: Ground) -> Array:
            omega = self.samples.omega
            return turns(robot, ground, omega, of_plate=self.of_plate, threads=self.threads)

        return twists

    @cached_property
    def layout(self) -> Layout:
        """Structure of the errors: v, w and the known lateral speeds, with one cluster per row."""
        kinds, rows = self._measured.shape
        known = np.isfinite(self._measured)
        kind = np.repeat(np.arange(kinds)[:, None], rows, axis=1)
        cluster = np.repeat(np.arange(rows)[None], kinds, axis=0)

        speed_error = rms(self.samples.omega) * self.geometry.sprocket_radius * _NUMERICAL_ERROR
        rate_error = speed_error / self.geometry.half_gauge
        floor = np.array([speed_error, rate_error, speed_error])
        return Layout(
            kind=kind[known],
            share=np.ones(known.sum()),
            cluster=cluster[known],
            floor=floor[:kinds],
            robust=rows >= _ROBUST_FROM,
        )

    def errors(self, candidate: Candidate) -> Array:
        """Errors (n,) in v [m/s], w [rad/s] and lateral speeds [m/s]."""
        errors = self.predicted(candidate)[: len(self._measured)] - self._measured
        return errors[np.isfinite(self._measured)]

    def predicted(self, candidate: Candidate) -> Array:
        """Simulated v, w and lateral speeds (3, M) at the sensor [m/s, rad/s]."""
        twist = self._turns(candidate.robot, candidate.ground)
        place = candidate.sensor
        w = twist[:, 2]
        # the sensor moves with the robot and, beside its centre, by its rotation
        velocity = twist[:, :2] + w[:, None] * [-place.y, place.x]
        ahead, left = se2.rotate(-place.yaw, velocity).T
        return np.stack([ahead, w, left])

    def metrics(self, errors: Array) -> dict[str, float]:
        """RMS errors in the speeds [m/s, rad/s], and in the slips, except those of sprockets at
        rest [-].
        """
        by_kind = np.full(self._measured.shape, np.nan)
        by_kind[np.isfinite(self._measured)] = errors
        metrics = {}
        for name, part in zip(("v_rms", "w_rms", "lateral_rms"), by_kind, strict=False):
            metrics[name] = rms(part[np.isfinite(part)])

        rows = np.isfinite(by_kind[:2]).all(axis=0)
        predicted = (self._measured[:2] + by_kind[:2]).T
        slip = track_slip(self.samples.omega[rows], predicted[rows], self.geometry)
        slip -= self.samples.slip[rows]
        metrics["slip_rms"] = rms(slip[np.isfinite(slip)])
        return metrics

    def compared(self, errors: Array) -> list[Compared]:
        """The speeds v and w and, where they are known, lateral speeds of all rows."""
        simulated = self._measured.copy()
        simulated[np.isfinite(self._measured)] += errors
        names = (("v", "m/s"), ("w", "rad/s"), ("lateral speed", "m/s"))
        quantities = zip(names, self._measured, simulated, strict=False)
        return [Compared(name, unit, *values) for (name, unit), *values in quantities]


def steady_turns(
    robot: RobotParameters, ground: Ground, omega: Array, of_plate: bool = False, threads: int = 0
) -> Array:
    """Simulated steady twists (M, 3) of a robot at sprocket speeds (M, 2) [rad/s]: forwards, to the
    left, yaw rate.

    The twists are those midway between the tracks or, with `of_plate`, those of the plate on the
    leaning robot.
    """
    # motors that are never too weak, with a margin for rounding
    fastest = 1.01 * float(np.abs(omega).max()) * robot.sprocket_radius
    drive = tireless(max(Drive.top_speed, fastest))
    start = np.zeros((len(omega), 3))
    fleet = Fleet(compiled(robot), start, ground, robot.radius_error, drive, threads)
    fleet.command(omega)
    fleet.advance(_time_to_be_steady(robot, ground, omega, fleet.period))
    twist = fleet.twist()
    if of_plate:  # leans to one side with the robot, where it moves at another speed forwards
        lean = se2.between(fleet.pose(), fleet.plate)[:, 1]
        twist[:, 0] -= twist[:, 2] * lean
    return twist


def _time_to_be_steady(
    robot: RobotParameters, ground: Ground, omega: Array, period: float
) -> float:
    """Settling time of turns at sprocket speeds `omega` (M, 2) [rad/s], in whole servo periods
    [s].
    """
    moving = np.abs(omega[omega != 0]) * robot.sprocket_radius
    if ground.shear == 0 or not moving.size:
        return _STEADY
    passed = _PASSES * robot.contact_length / float(moving.min())
    return round(min(_STEADY + passed, _LONGEST) / period) * period


class Drives:
    """Windows of drives, compared with simulations by the robot's motion over several horizons."""

    def __init__(
        self,
        logs: Sequence[RunLog],
        geometry: RobotGeometry,
        inputs: Inputs = "encoders",
        threads: int = 0,
    ) -> None:
        """Cut logs into windows of about 6.5 s, in which encoders or commands drive the simulated
        robots.

        Within a window, poses don't jump. If there are many windows, 100 to 200 of them are used,
        evenly chosen. Raises LogError for logs that identification refuses, and if no poses have
        headings.
        """
        windows = _all_windows(logs, geometry)
        stride = math.ceil(len(windows) / _MAX_WINDOWS)
        windows = windows[::stride]

        # what is simulated, and what is compared
        self.windows = [window.log for window in windows]
        """Windows (W) that are compared."""
        replayer = Replayer([window.with_lead for window in windows], inputs)
        self._motion = lru_cache(_CACHED_MOTIONS)(partial(replayer.run, threads=threads))
        self._pairs = _Pairs.of(self.windows, geometry)
        self._measured = se2.between(self._pairs.pose[:, 0], self._pairs.pose[:, 1])
        self.horizon = self._pairs.horizon
        """Horizon of each pair [s]."""
        source = np.array([window.source for window in windows])
        self.log = np.repeat(source[self._pairs.window], 3)
        """Index of each error's log (n,)."""
        self.layout = self._layout()
        """Structure of the errors: forwards, to the left and heading for each pair; each horizon
        has its own kinds.
        """

    def _layout(self) -> Layout:
        # in windows with the same constant command, all pairs over a horizon tell the same, so
        # that together they have the weight of one
        label = _same_commands(self.windows)[self._pairs.window]
        cluster = _renumbered(label)
        horizon = np.searchsorted(HORIZONS, self.horizon)
        _, which, count = np.unique(
            np.stack([cluster, horizon]), axis=1, return_inverse=True, return_counts=True
        )
        pairs_alike = count[which.reshape(-1)]

        # three kinds of errors, forwards, to the left and heading, for each horizon
        kind = _renumbered((3 * horizon[:, None] + np.arange(3)).ravel())
        kinds = int(kind.max()) + 1
        return Layout(
            kind=kind,
            share=np.repeat(1 / pairs_alike, 3),
            cluster=np.repeat(cluster, 3),
            floor=np.full(kinds, _NUMERICAL_ERROR),  # [m, rad]
            robust=True,
        )

    def motion(self, candidate: Candidate) -> Replay:
        """Simulated motion in all windows."""
        return self._motion(candidate.robot, candidate.ground)

    def errors(self, candidate: Candidate) -> Array:
        """Errors (n,) for each pair: forwards, to the left and heading in the first pose's frame
        [m, m, rad].
        """
        motion = self.motion(candidate)
        window = self._pairs.window
        time = self._pairs.time + candidate.clock
        first = motion.sensor_at(window, candidate.sensor, time[:, 0])
        last = motion.sensor_at(window, candidate.sensor, time[:, 1])
        error = se2.between(first, last) - self._measured
        error[:, 2] = se2.wrap_angle(error[:, 2])
        return np.asarray(error).ravel()

    def metrics(self, errors: Array) -> dict[str, float]:
        """Median, 90 % quantile and RMS of the errors in position [m] and heading [rad], by
        horizon.
        """
        known = np.isfinite(errors[::3])
        by_pair = errors.reshape(-1, 3)[known]
        of_pair = self.horizon[known]
        metrics: dict[str, float] = {}
        for horizon in np.unique(of_pair):
            ahead, left, heading = by_pair[of_pair == horizon].T
            sizes = {"position": np.hypot(ahead, left), "heading": np.abs(heading)}
            for name, size in sizes.items():
                prefix = f"{name}_{horizon:g}s"
                metrics[f"{prefix}_median"] = float(np.median(size))
                metrics[f"{prefix}_p90"] = float(np.quantile(size, 0.9))
                metrics[f"{prefix}_rms"] = float(rms(size))
        return metrics

    def compared(self, errors: Array) -> list[Compared]:
        """The motion forwards, to the left and in heading over the longest horizon."""
        longest = float(self.horizon.max())
        rows = self.horizon == longest
        measured = self._measured[rows]
        simulated = measured + errors.reshape(-1, 3)[rows]
        names = (("forwards", "m"), ("to the left", "m"), ("turned", "rad"))
        quantities = zip(names, measured.T, simulated.T, strict=True)
        return [
            Compared(f"{name} in {longest:g} s", unit, *values)
            for (name, unit), *values in quantities
        ]


@dataclass(frozen=True)
class _Window:
    """A part of a drive that is compared with its simulation."""

    log: RunLog
    with_lead: RunLog  # the window and the time before it, which is replayed, too
    source: int  # index of the log that the window is from


def _all_windows(logs: Sequence[RunLog], geometry: RobotGeometry) -> list[_Window]:
    """All windows of drives, within which poses don't jump."""
    windows = []
    for source, parts in enumerate(without_jumps(logs, geometry)):
        for part in parts:
            windows += [_Window(log, _with_lead(part, log), source) for log in _windows(part)]
    return windows


def _renumbered(label: np.ndarray) -> np.ndarray:
    """Labels (n,) that count from 0 without gaps, in the same order."""
    return np.unique(label, return_inverse=True)[1]


@dataclass(frozen=True)
class _Pairs:
    """Pairs of measured poses, a horizon apart, between which the robot moves."""

    horizon: Array  # (n,) [s]
    window: np.ndarray  # (n,) index of the window
    time: Array  # (n, 2), by the pose clock [s]
    pose: Array  # (n, 2, 3) measured poses

    @classmethod
    def of(cls, windows: Sequence[RunLog], geometry: RobotGeometry) -> _Pairs:
        """The pairs of poses in windows, about four per horizon; raises LogError if there are
        none.
        """
        parts = [
            cls._in_window(k, log, horizon, geometry)
            for k, log in enumerate(windows)
            if np.count_nonzero(log.has_heading) > 1
            for horizon in HORIZONS
        ]
        if not parts:
            raise LogError(
                "no poses with headings (phi): a calibration compares positions and headings"
            )
        pairs = cls(
            horizon=np.concatenate([part.horizon for part in parts]),
            window=np.concatenate([part.window for part in parts]),
            time=np.concatenate([part.time for part in parts]),
            pose=np.concatenate([part.pose for part in parts]),
        )
        if not len(pairs.horizon):
            raise LogError(f"no poses {HORIZONS[0]:g} s apart between which the robot drives")
        return pairs

    @classmethod
    def _in_window(cls, k: int, log: RunLog, horizon: float, geometry: RobotGeometry) -> _Pairs:
        """The pairs a `horizon` [s] apart in the window `k`."""
        rows = np.flatnonzero(log.has_heading)
        time = log.time[rows]
        interval = float(np.median(np.diff(time)))

        # pairs whose times differ by the horizon, but for half an interval
        stride = max(1, round(horizon / _PAIRS / interval))
        first = np.arange(0, len(rows), stride)
        last = np.searchsorted(time, time[first] + horizon - interval / 2)
        last = last.clip(max=len(rows) - 1)
        deviation = time[last] - time[first] - horizon
        is_apart = np.abs(deviation) <= interval / 2 + _ROUNDING

        # travel of the faster belt until each pose
        turned = np.abs(log.omega).max(axis=1)[1:] * np.diff(log.time)
        belt_travel = np.append(0.0, np.cumsum(turned * geometry.sprocket_radius))[rows]
        driven = belt_travel[last] - belt_travel[first]
        is_moving = driven > _MIN_DRIVEN * geometry.half_gauge

        chosen = is_apart & is_moving
        ends = np.stack([first[chosen], last[chosen]], axis=1)
        return cls(
            horizon=np.full(len(ends), horizon),
            window=np.full(len(ends), k),
            time=time[ends],
            pose=log.pose[rows[ends]],
        )


def _windows(log: RunLog) -> list[RunLog]:
    """Cut a log, from its first to its last valid pose, into parts of about 6.5 s.

    If these two poses are at least 9.5 s apart, the first 3 s are replayed without being compared.
    """
    first, last = np.flatnonzero(log.is_valid)[[0, -1]].tolist()
    if log.time[last] - log.time[first] >= _LEAD + _WINDOW:
        first = int(np.searchsorted(log.time, log.time[first] + _LEAD))
    return log.between(first, last + 1).cut(_WINDOW)


def _with_lead(log: RunLog, part: RunLog) -> RunLog:
    """The part of a log, with the 3 s before it as far as the log has them."""
    ends = [part.time[0] - _LEAD, part.time[-1]]
    first, last = np.searchsorted(log.time, ends).tolist()
    return log.between(first, last + 1)


def _same_commands(logs: Sequence[RunLog]) -> np.ndarray:
    """Labels (N,) of windows, equal for neighbours with the same constant command."""
    commands = [_constant_command(log) for log in logs]
    label = np.zeros(len(logs), int)
    for k in range(1, len(logs)):
        is_same = commands[k] is not None and commands[k] == commands[k - 1]
        label[k] = label[k - 1] if is_same else label[k - 1] + 1
    return label


def _constant_command(log: RunLog) -> list[float] | None:
    """The command in all rows of a log; None if it changes or isn't known."""
    if log.command is None or np.ptp(log.command, axis=0).max() != 0:
        return None
    return list(log.command[0].tolist())
