"""Calibration targets: data on a robot's motion, and the errors of a candidate that repeats it in
simulation.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import Protocol

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

SLIP_SCALE = 0.007
"""Scale of slip errors in a table of turns, about the residual of the best fit to the published
slips [-].
"""
# scale of relative radius errors [-]: the best fit leaves 0.05; radii have half the weight
_RADIUS_SCALE = 0.07
_TOP_SPEED = 0.3  # of the paper's robot; faster commands are scaled down, both tracks alike [m/s]
_STEADY = 2.0  # time after which the motion is steady [s]
# on shearing ground: extra travel of the slowest belt [contact lengths]; limit [s]
_PASSES, _LONGEST = 2.0, 12.0
_NUMERICAL_ERROR = 2e-5  # relative error of the simulated motion [-]
HORIZONS = (0.5, 1.0, 1.8, 5.0)
"""Horizons over which a drive is compared with its simulation [s]."""
_PAIRS = 4.0  # approximate number of pose pairs that begin within a horizon
_MIN_DRIVEN = 0.1  # belt travel above which a robot is moving [half gauges]
_WINDOW = 6.5  # duration of the windows that are cut from drives [s]
# time replayed before a window, if the drive is long enough, to forget the initial state, even on
# ice [s]
_LEAD = 3.0
_MAX_WINDOWS = 200
_KEPT = 3  # number of cached motions
_FEW = 20  # number of steady rows at which single wrong rows are evident


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


class Target(Protocol):
    """Data on a robot's motion: n measured numbers."""

    @property
    def layout(self) -> Layout:
        """Structure of the errors."""

    def errors(self, candidate: Candidate) -> Array:
        """Errors (n,) of a candidate, simulated minus measured."""

    def metrics(self, errors: Array) -> dict[str, float]:
        """Summary of errors (n,), without those that are NaN."""


# radii [m] and speeds [m/s] (2, M)
_COMMANDED = np.array(list(itertools.product(COMMANDED_RADII, SPEEDS))).T
_OBSERVED = np.repeat(OBSERVED_RADII, len(SPEEDS))  # radii (M,) [m]
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
        share = np.full(len(cluster), 3 * len(COMMANDED_RADII) / len(cluster))
        floor = np.array([_NUMERICAL_ERROR / SLIP_SCALE])
        return Layout(np.zeros(len(cluster), int), share, cluster, floor, robust=False)

    def errors(self, candidate: Candidate) -> Array:
        """Errors (n,) in the slips and in the logarithms of the radii, each divided by its
        scale.
        """
        (radius, speed), geometry = _COMMANDED, candidate.geometry
        wanted = sprocket_speeds(np.stack([speed, speed / radius], axis=-1), 0.0, geometry)
        omega = limit_sprocket_speeds(wanted, _TOP_SPEED / geometry.sprocket_radius)
        turns = self.turns or steady_turns
        twist = turns(candidate.robot, candidate.ground, omega, threads=self.threads)[:, [0, 2]]
        slip = (track_slip(omega, twist, geometry) - PUBLISHED(1 / _OBSERVED)) / SLIP_SCALE
        radius = np.log(twist[:, 0] / twist[:, 1] / _OBSERVED) / _RADIUS_SCALE
        return np.concatenate([slip.ravel(), radius])

    def metrics(self, errors: Array) -> dict[str, float]:
        """RMS errors in the slips, and RMS relative errors in the radii [-]."""
        slip, radius = (part[np.isfinite(part)] for part in np.split(errors, [2 * len(_OBSERVED)]))
        return {
            "slip_rms": rms(slip * SLIP_SCALE),
            "radius_rms": rms(np.expm1(radius * _RADIUS_SCALE)),
        }


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
        lateral = self.samples.lateral
        known = lateral is not None and bool(np.isfinite(lateral).any())
        return np.array([*self.samples.twist.T] + ([lateral] if known else []))

    @cached_property
    def _turns(self) -> Callable[[RobotParameters, Ground], Array]:
        """Steady twists (M, 3), cached for candidates that differ only in the sensor."""

        turns: Turns = partial(
            self.turns or steady_turns, of_plate=self.of_plate, threads=self.threads
        )
        return lru_cache(_KEPT)(lambda robot, ground: turns(robot, ground, self.samples.omega))

    @cached_property
    def layout(self) -> Layout:
        """Structure of the errors: v, w and the known lateral speeds, with one cluster per row."""
        kinds, rows = self._measured.shape
        known = np.isfinite(self._measured).ravel()
        fastest = rms(self.samples.omega) * self.geometry.sprocket_radius * _NUMERICAL_ERROR
        floor = np.array([fastest, fastest / self.geometry.half_gauge, fastest])[:kinds]
        kind, cluster = np.repeat(np.arange(kinds), rows), np.tile(np.arange(rows), kinds)
        return Layout(kind[known], np.ones(known.sum()), cluster[known], floor, robust=rows >= _FEW)

    def errors(self, candidate: Candidate) -> Array:
        """Errors (n,) in v [m/s], w [rad/s] and lateral speeds [m/s]."""
        errors = self.predicted(candidate)[: len(self._measured)] - self._measured
        return errors[np.isfinite(self._measured)]

    def predicted(self, candidate: Candidate) -> Array:
        """Simulated v, w and lateral speeds (3, M) at the sensor [m/s, rad/s]."""
        twist, place = self._turns(candidate.robot, candidate.ground), candidate.sensor
        w = twist[:, 2]
        moved = se2.rotate(-place.yaw, twist[:, :2] + w[:, None] * [-place.y, place.x])
        return np.stack([moved[:, 0], w, moved[:, 1]])

    def metrics(self, errors: Array) -> dict[str, float]:
        """RMS errors in the speeds [m/s, rad/s], and in the slips, except those of sprockets at
        rest [-].
        """
        parts = np.full(self._measured.shape, np.nan)
        parts[np.isfinite(self._measured)] = errors
        rows = np.isfinite(parts[:2]).all(axis=0)
        names = ("v_rms", "w_rms", "lateral_rms")
        metrics = {
            name: rms(part[np.isfinite(part)]) for name, part in zip(names, parts, strict=False)
        }
        slip = track_slip(
            self.samples.omega[rows], (self._measured[:2] + parts[:2]).T[rows], self.geometry
        )
        slip -= self.samples.slip[rows]
        return metrics | {"slip_rms": rms(slip[np.isfinite(slip)])}


def steady_turns(
    robot: RobotParameters, ground: Ground, omega: Array, of_plate: bool = False, threads: int = 0
) -> Array:
    """Simulated steady twists (M, 3) of a robot at sprocket speeds (M, 2) [rad/s]: forwards, to the
    left, yaw rate.

    The twists are those midway between the tracks or, with `of_plate`, those of the plate on the
    leaning robot.
    """
    drive = tireless(
        max(Drive.top_speed, 1.01 * float(np.abs(omega).max()) * robot.sprocket_radius)
    )
    fleet = Fleet(
        compiled(robot), np.zeros((len(omega), 3)), ground, robot.radius_error, drive, threads
    )
    fleet.command(omega)
    fleet.advance(_time_to_be_steady(robot, ground, omega, fleet.period))
    twist = fleet.twist()
    if of_plate:  # the plate leans to one side with the robot
        twist[:, 0] -= twist[:, 2] * se2.between(fleet.pose(), fleet.plate)[:, 1]
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

        Within a window, poses don't jump. If there are many windows, about 200 of them are used,
        evenly chosen. Raises LogError for logs that identification refuses, and if no poses have
        headings.
        """
        windows = [
            (k, window, _with_lead(part, window))
            for k, parts in enumerate(without_jumps(logs, geometry))
            for part in parts
            for window in _windows(part)
        ]
        of_log, self.windows, led = map(
            list, zip(*windows[:: -(-len(windows) // _MAX_WINDOWS)], strict=True)
        )
        replayer = Replayer(led, inputs)
        self._motion = lru_cache(_KEPT)(partial(replayer.run, threads=threads))
        self._pairs = _Pairs.of(self.windows, geometry)
        self.horizon, window = self._pairs.horizon, self._pairs.window
        self._measured = se2.between(*self._pairs.pose.swapaxes(0, 1))
        self.log = np.repeat(np.array(of_log)[window], 3)  # index of each error's log (n,)
        cluster = _same_commands(self.windows)[window]
        cluster = np.unique(cluster, return_inverse=True)[1]
        group = 3 * np.searchsorted(HORIZONS, self.horizon)
        number = np.unique(
            np.stack([cluster, group]), axis=1, return_inverse=True, return_counts=True
        )
        alike = number[2][number[1].reshape(-1)]
        kind = np.unique((group[:, None] + np.arange(3)).ravel(), return_inverse=True)[1]
        floor = np.full(int(kind.max()) + 1, _NUMERICAL_ERROR)  # [m, rad]
        self.layout = Layout(
            kind, np.repeat(1 / alike, 3), np.repeat(cluster, 3), floor, robust=True
        )
        """Structure of the errors: forwards, to the left and heading for each pair; each horizon
        has its own kinds.
        """

    def motion(self, candidate: Candidate) -> Replay:
        """Simulated motion in all windows."""
        return self._motion(candidate.robot, candidate.ground)

    def errors(self, candidate: Candidate) -> Array:
        """Errors (n,) for each pair: forwards, to the left and heading in the first pose's frame
        [m, m, rad].
        """
        motion, place, window = self.motion(candidate), candidate.sensor, self._pairs.window
        first, last = (
            motion.sensor_at(window, place, time + candidate.clock) for time in self._pairs.time.T
        )
        error = se2.between(first, last) - self._measured
        error[:, 2] = se2.wrap_angle(error[:, 2])
        return np.asarray(error).ravel()

    def metrics(self, errors: Array) -> dict[str, float]:
        """Median, 90 % quantile and RMS of the errors in position [m] and heading [rad], by
        horizon.
        """
        known = np.isfinite(errors[::3])
        each, metrics = errors.reshape(-1, 3)[known], dict[str, float]()
        for horizon in np.unique(self.horizon[known]):
            rows = each[self.horizon[known] == horizon]
            for name, size in (
                ("position", np.hypot(rows[:, 0], rows[:, 1])),
                ("heading", np.abs(rows[:, 2])),
            ):
                values = np.median(size), np.quantile(size, 0.9), rms(size)
                statistics = zip(("median", "p90", "rms"), map(float, values), strict=True)
                metrics |= {
                    f"{name}_{horizon:g}s_{statistic}": value for statistic, value in statistics
                }
        return metrics


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
        headed = [
            (k, log, rows)
            for k, log in enumerate(windows)
            if len(rows := np.flatnonzero(log.has_heading)) > 1
        ]
        if not headed:
            raise LogError(
                "no poses with headings (phi): a calibration compares positions and headings"
            )
        parts: list[tuple[Array, ...]] = []
        for k, log, rows in headed:
            time, interval = log.time[rows], float(np.median(np.diff(log.time[rows])))
            belts = np.abs(log.omega).max(axis=1)[1:] * np.diff(log.time) * geometry.sprocket_radius
            way = np.append(0.0, np.cumsum(belts))[rows]
            for horizon in HORIZONS:
                first = np.arange(0, len(rows), max(1, round(horizon / _PAIRS / interval)))
                last = np.searchsorted(time, time[first] + horizon - interval / 2).clip(
                    max=len(rows) - 1
                )
                apart = np.abs(time[last] - time[first] - horizon) <= interval / 2 + 1e-9
                apart &= way[last] - way[first] > _MIN_DRIVEN * geometry.half_gauge
                ends = np.stack([first[apart], last[apart]], axis=1)
                parts.append(
                    (
                        np.full(len(ends), horizon),
                        np.full(len(ends), k),
                        time[ends],
                        log.pose[rows[ends]],
                    )
                )
        pairs = cls(*(np.concatenate(column) for column in zip(*parts, strict=True)))
        if not len(pairs.horizon):
            raise LogError(f"no poses {HORIZONS[0]:g} s apart between which the robot drives")
        return pairs


def _windows(log: RunLog) -> list[RunLog]:
    """Cut a log, from its first to its last valid pose, into parts of about 6.5 s.

    If these two poses are at least 9.5 s apart, the first 3 s are replayed without being compared.
    """
    first, last = np.flatnonzero(log.is_valid)[[0, -1]].tolist()
    if log.time[last] - log.time[first] >= _LEAD + _WINDOW:
        first = int(np.searchsorted(log.time, log.time[first] + _LEAD))
    return log.between(first, last + 1).cut(_WINDOW)


def _with_lead(log: RunLog, part: RunLog) -> RunLog:
    first, last = np.searchsorted(log.time, [part.time[0] - _LEAD, part.time[-1]]).tolist()
    return log.between(first, last + 1)


def _same_commands(logs: Sequence[RunLog]) -> np.ndarray:
    """Labels (N,) of windows, equal for neighbours with the same constant command."""
    label, last = np.zeros(len(logs), int), None
    for k, log in enumerate(logs):
        command = log.command
        constant = command is not None and bool(np.ptp(command, axis=0).max() == 0)
        this = command[0].tolist() if command is not None and constant else None
        label[k] = label[k - 1] + (k > 0 and (this is None or this != last))
        last = this
    return label
