"""The model of a drive: a law, and the effects of the sensor's mounting, its clock and the robot's lag on the poses.

Its parameters are the law's, followed by EXTRAS:

- sensor_x: how far ahead of the turning centre the sensor sits [m]. The centre may lie ahead of or behind the middle of
  the tracks; the two can't be told apart.
- sensor_y: how far to the left of the middle the sensor sits [m].
- drift: c, outward drift in turns, a lateral speed of -c v w [s].
- clock_offset: tau, encoder clock minus pose clock [s]: encoders show at stamp t + tau what poses show at stamp t.
- sensor_yaw: heading of the sensor minus heading of the robot [rad].
- lag: time constant with which the motion follows the belts [s].
- gyro_bias, gyro_scale: a gyro reads (1 + scale) yaw rate + bias [rad/s, -].
- gyro_clock: gyro's clock minus pose clock [s]; it differs from tau where encoders are read late.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from trackslip import se2
from trackslip.identification.drives import PreparedDrive, Timeline
from trackslip.kinematics import Array, RobotGeometry
from trackslip.logs.runlog import MEASURED
from trackslip.se2 import arc_quotients
from trackslip.slip.derivatives import twist_derivatives
from trackslip.slip.families import LawFamily


@dataclass(frozen=True)
class Extra:
    """A parameter that isn't the law's."""

    unit: str
    scale: float
    """A change that matters."""
    prior: float
    """Standard deviation of the prior, around 0 or a given value."""
    low: float
    high: float
    title: str


EXTRAS: dict[str, Extra] = {
    "sensor_x": Extra("m", 0.05, 1.0, -10.0, 10.0, "sensor ahead of the turning centre"),
    "sensor_y": Extra("m", 0.02, 0.5, -10.0, 10.0, "sensor to the left"),
    "drift": Extra("s", 0.05, 0.3, -5.0, 5.0, "outward drift in turns"),
    "clock_offset": Extra("s", 0.05, 2.0, -10.0, 10.0, "encoder clock minus pose clock"),
    "sensor_yaw": Extra("rad", 0.02, 1.0, -4.0, 4.0, "heading of the sensor in the robot"),
    "lag": Extra("s", 0.05, 0.1, 0.0, 2.0, "lag of the motion behind the belts"),
    "gyro_bias": Extra("rad/s", 0.01, 0.05, -1.0, 1.0, "bias of the gyro"),
    "gyro_scale": Extra("", 0.02, 0.03, -0.5, 0.5, "error of the gyro's scale"),
    "gyro_clock": Extra("s", 0.05, 2.0, -10.0, 10.0, "gyro's clock minus pose clock"),
}
GYRO = ("gyro_bias", "gyro_scale", "gyro_clock")
"""The last of them, for drives with a gyro."""
_LAG_DIFFERENCE = 1e-3  # [s]
_MIN_LAG = 1e-3  # while it is estimated [s]


@dataclass(frozen=True)
class Steps:
    """Motion of the turning centre between neighbouring nodes, by the law."""

    motion: Array  # (3, K - 1): displacement in the frame of the first node [m, m], turn [rad]
    slope: Array  # (3, f, K - 1) by the chosen parameters; those of the sensor's place and yaw have none
    distance: Array  # (K - 1,) mean way of the two belts [m]
    velocity: np.ndarray  # (K,) complex, forwards and to the left, at the nodes [m/s]
    yaw_rate: Array  # (K,) [rad/s]
    path: Array  # (K, 3) of the turning centre from the origin [m, m, rad]


@dataclass(frozen=True)
class DriveModel:
    """A family of laws with EXTRAS, for a robot."""

    family: LawFamily
    geometry: RobotGeometry
    gyro: bool = False
    """True for drives with a gyro; without, the parameters GYRO are missing."""

    @property
    def extras(self) -> dict[str, Extra]:
        """The parameters that aren't the law's."""
        return {name: extra for name, extra in EXTRAS.items() if self.gyro or name not in GYRO}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters, in the order of their values in arrays (p,)."""
        return (*self.family.names, *self.extras)

    def index(self, name: str) -> int:
        """Place of a parameter in arrays of values."""
        return self.names.index(name)

    @property
    def limits(self) -> Array:
        """Lower limits, upper limits and scales (3, p)."""
        extras = np.array([(e.low, e.high, e.scale) for e in self.extras.values()]).T
        return np.concatenate([self.family.limits(self.geometry.half_gauge), extras], axis=1)

    @property
    def prior(self) -> Array:
        """Standard deviations (p,) of the priors; the law's are too wide to matter where data say anything."""
        scale = self.family.limits(self.geometry.half_gauge)[2]
        return np.concatenate([10 * scale, [extra.prior for extra in self.extras.values()]])

    def room(self, values: Array, free: np.ndarray) -> Array:
        """Smallest and largest changes (2, f) of the parameters `free` (f,) that `moved` allows."""
        room = (self.limits[:2] - values)[:, free]
        if self._lags(free):
            room[0, free == self.index("lag")] /= 2
        return room

    def moved(self, values: Array, free: np.ndarray, by: Array) -> Array:
        """Values (p,) after a change `by` (f,) of the parameters `free` (f,), to first order.

        The motion depends on a short lag by the delay, which the clock offset shares, and beyond that by its square.
        So a large step changes the clock offset less the lag, and the lag's square. At a lag of 0 the two can't be
        told apart: it stays above.
        """
        moved = values.copy()
        moved[free] += by
        if self._lags(free):
            lag, clock = self.index("lag"), self.index("clock_offset")
            square = values[lag] * (2 * moved[lag] - values[lag])
            further = np.sqrt(max(square, _MIN_LAG**2)) - moved[lag]
            moved[[lag, clock]] += further
        return moved

    def _lags(self, free: np.ndarray) -> bool:
        """True if both the lag and the clock offset are among the parameters `free` (f,)."""
        return bool(np.isin([self.index("lag"), self.index("clock_offset")], free).all())

    def steps(self, values: Array, line: Timeline, free: np.ndarray) -> Steps:
        """Dead reckoning of drives with parameter values (p,), with derivatives by the parameters `free` (f,)."""
        law = len(self.family.names)
        extra = dict(zip(self.extras, values[law:], strict=True))
        motion, slope = self._motion(values[:law], extra, line, free)
        time = line.time + extra["clock_offset"]
        path = path_at(line.edges, motion, slope, time, line.intervals(time))
        clock = free == self.index("clock_offset")
        path.place_slope[clock] += path.velocity
        path.heading_slope[clock] += path.yaw_rate
        back = np.exp(-1j * path.heading[:-1])
        moved = np.diff(path.place) * back
        by = np.diff(path.place_slope, axis=-1) * back - (1j * moved) * path.heading_slope[:, :-1]
        return Steps(
            np.stack([moved.real, moved.imag, np.diff(path.heading)]),
            np.stack([by.real, by.imag, np.diff(path.heading_slope, axis=-1)]),
            self._distance(line, line.within(time)),
            path.velocity * np.exp(-1j * path.heading),
            path.yaw_rate,
            np.column_stack([path.place.real, path.place.imag, path.heading]),
        )

    def gyro_turns(self, values: Array, line: Timeline, free: np.ndarray) -> tuple[Array, Array]:
        """Readings (K - 1,) of the gyro between nodes, less bias, in rad, NaN for none; derivatives (f, K - 1)."""
        assert line.gyro is not None
        bias, offset = values[self.index("gyro_bias")], values[self.index("gyro_clock")]
        time, step = line.time + offset, np.diff(line.time)
        reading, rate = np.diff(line.gyro_turn(time)), line.gyro_turn(time, 1)
        slope = np.zeros((len(free), len(step)))
        slope[free == self.index("gyro_clock")] = np.diff(rate)
        slope[free == self.index("gyro_bias")] = -step
        whole = np.diff(np.interp(time, line.gyro[:, 0], line.gyro[:, 2])) >= MEASURED * step
        return np.where(whole, reading - bias * step, np.nan), slope

    def sensor_path(self, values: Array, drive: PreparedDrive) -> Array:
        """Positions of the sensor and headings of the robot (K, 3) by dead reckoning, from anywhere."""
        return self.of_sensor(values, self.steps(values, Timeline.of([drive]), np.zeros(0, int)).path)

    def of_sensor(self, values: Array, path: Array) -> Array:
        """Positions of the sensor and headings (K, 3) of a robot whose turning centre follows a path (K, 3)."""
        lever = values[[self.index("sensor_x"), self.index("sensor_y")]]
        return np.column_stack([se2.to_world(path, lever), path[:, 2]])

    def _motion(
        self, values: Array, extra: Mapping[str, float], line: Timeline, free: np.ndarray
    ) -> tuple[Array, Array]:
        """Motion (3, M) in the encoder intervals, and its derivatives (3, f, M) by the parameters `free` (f,)."""
        law, lag, drift = len(values), extra["lag"], extra["drift"]
        slope = np.zeros((3, len(free), len(line.omega)))
        of_law = free < law
        twist = self.family.law(values, self.geometry).twist(line.omega, self.geometry)
        if of_law.any():
            by_law = twist_derivatives(self.family, values[None], line.omega, self.geometry, twist[None])[0]
            by_law = _lagging(np.moveaxis(by_law, 0, -1)[:, free[of_law]], line, lag)
            slope[0, of_law], slope[2, of_law] = by_law
        belts = np.moveaxis(twist, 0, -1)
        v, w = lagged = _lagging(belts, line, lag)
        at_lag = free == self.index("lag")
        if at_lag.any():
            later = _lagging(belts, line, lag + _LAG_DIFFERENCE)
            slope[::2, at_lag] = ((later - lagged) / _LAG_DIFFERENCE)[:, None]
        if drift:
            slope[1] = -drift * (v * slope[2] + w * slope[0])
        slope[1, free == self.index("drift")] -= v * w
        return np.stack([v, -drift * v * w, w]), slope

    def _distance(self, line: Timeline, time: Array) -> Array:
        """Mean way (K - 1,) of the two belts between nodes at times (K,) [m]."""
        speed = self.geometry.sprocket_radius * np.abs(line.omega).mean(axis=1)
        ways = np.concatenate([[0.0], np.cumsum(speed * np.diff(line.edges))])
        return np.diff(np.interp(time, line.edges, ways))


def _lagging(values: Array, line: Timeline, lag: float) -> Array:
    """Means (..., M) in the intervals of a first-order lag [s] behind values (..., M); each drive starts settled."""
    if lag <= 0:
        return values
    step, begins = np.diff(line.edges), line.begins
    kept = np.exp(-step / lag)
    driven = (1 - kept) * values
    driven[..., begins] += kept[begins] * values[..., begins]
    bands = np.stack([np.ones(len(step)), np.append(-kept[1:], 0.0)])
    bands[1, begins[1:] - 1] = 0.0
    flat = driven.reshape(-1, len(step)).T
    ends = scipy.linalg.solve_banded((1, 0), bands, flat, overwrite_b=True, check_finite=False).T.reshape(driven.shape)
    before = np.roll(ends, 1, axis=-1)
    before[..., begins] = values[..., begins]
    return values + (before - values) * ((lag / step) * (1 - kept))


@dataclass(frozen=True)
class Path:
    """A path from the origin at given times, with derivatives by p parameters; places are x + i y."""

    place: np.ndarray  # (K,) complex [m]
    heading: Array  # (K,) [rad]
    place_slope: np.ndarray  # (p, K) complex
    heading_slope: Array  # (p, K)
    velocity: np.ndarray  # (K,) complex, of the place by the time [m/s]
    yaw_rate: Array  # (K,) [rad/s]


def path_at(edges: Array, motion: Array, slope: Array, time: Array, row: np.ndarray) -> Path:
    """The path at `time` (K,) of a robot that moves with (v, u, w), forwards, to the left and turning.

    `motion` (3, M) is constant in each interval between `edges` (M + 1,), its derivatives are `slope` (3, p, M). `row`
    (K,) is the interval that each time lies in, or whose motion continues until then.
    """
    step = np.diff(edges)
    turned, turned_slope = _started(motion[2] * step), _started(slope[2] * step)
    moved, moved_slope = _displaced(motion, slope, step, turned[:-1], turned_slope[:, :-1])
    reached, reached_slope = _started(moved), _started(moved_slope)
    rest, here, here_slope = time - edges[row], motion[:, row], slope[..., row]
    heading, heading_slope = turned[row], turned_slope[:, row]
    moved, moved_slope = _displaced(here, here_slope, rest, heading, heading_slope)
    heading = heading + here[2] * rest
    return Path(
        reached[row] + moved,
        heading,
        reached_slope[:, row] + moved_slope,
        heading_slope + here_slope[2] * rest,
        np.exp(1j * heading) * (here[0] + 1j * here[1]),
        here[2],
    )


def _displaced(
    motion: Array, slope: Array, step: Array, heading: Array, heading_slope: Array
) -> tuple[np.ndarray, np.ndarray]:
    """World displacement (M,) by motions (3, M) for `step` (M,) from headings (M,), and derivatives (p, M)."""
    along, across, d_along, d_across = arc_quotients(motion[2] * step)
    turned, velocity = np.exp(1j * heading), motion[0] + 1j * motion[1]
    by_velocity = turned * (along + 1j * across) * step
    by_turn = turned * velocity * (d_along + 1j * d_across) * step**2
    moved = by_velocity * velocity
    moved_slope = by_velocity * slope[0] + (1j * by_velocity) * slope[1]
    moved_slope += by_turn * slope[2]
    moved_slope += (1j * moved) * heading_slope
    return moved, moved_slope


def _started(increments: np.ndarray) -> np.ndarray:
    """Sums (..., M + 1) from zero of increments (..., M)."""
    sums = np.zeros((*increments.shape[:-1], increments.shape[-1] + 1), increments.dtype)
    np.cumsum(increments, axis=-1, out=sums[..., 1:])
    return sums
