"""The drive model: a law, and how the sensor's mounting, its clock and the robot's lag affect the
poses.

The model's parameters are those of the law, followed by EXTRAS. The turning centre may lie ahead of
the middle of the tracks; sensor_x is the sensor's distance ahead of the turning centre. A drift c
causes a lateral speed of -c v w. Encoder readings stamped t + clock_offset belong to poses stamped
t. A gyro reads (1 + gyro_scale) yaw rate + gyro_bias.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from trackslip.drives.drive import Drives
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.families import LawFamily

GYRO: Final = ("gyro_bias", "gyro_scale")  # the last of EXTRAS, for drives with a gyro
FAR_PRIORS: Final = {"sensor_x": 0.05, "sensor_y": 0.05, "sensor_yaw": 0.02}
"""Prior standard deviations for drives with few poses, far apart, in the units of `Extra.prior`: a
sensor that may be anywhere would take up the effects of unequal radii.
"""
_LAG_STEP: Final = 1e-3  # step of finite differences by the lag, smaller than any that matters [s]
_SMALL_TURN: Final = 1e-4  # turn up to which a series has no rounding errors [rad]


@dataclass(frozen=True)
class Extra:
    """A parameter of a drive model that doesn't belong to the law."""

    unit: str
    scale: float  # smallest change of the parameter that matters
    prior: float  # prior standard deviation around 0 or a given value; in half gauges for a length
    low: float
    high: float
    title: str


EXTRAS: Final[dict[str, Extra]] = {
    "sensor_x": Extra("m", 0.05, 2.0, -10.0, 10.0, "sensor ahead of the turning centre"),
    "sensor_y": Extra("m", 0.02, 1.0, -10.0, 10.0, "sensor to the left"),
    "drift": Extra("s", 0.05, 0.3, -5.0, 5.0, "outward drift in turns"),
    "clock_offset": Extra("s", 0.05, 2.0, -10.0, 10.0, "encoder clock minus pose clock"),
    "sensor_yaw": Extra("rad", 0.02, 1.0, -4.0, 4.0, "heading of the sensor in the robot"),
    "lag": Extra("s", 0.05, 0.1, 0.0, 2.0, "lag of the motion behind the belts"),
    "gyro_bias": Extra("rad/s", 0.01, 0.05, -1.0, 1.0, "bias of the gyro"),
    "gyro_scale": Extra("", 0.02, 0.03, -0.5, 0.5, "error of the gyro's scale"),
}


@dataclass(frozen=True)
class DriveModel:
    """A law family with EXTRAS, for one robot."""

    family: LawFamily
    geometry: RobotGeometry
    # true for drives with a gyro; otherwise the model is without the GYRO parameters
    gyro: bool = False
    radius_prior: float = 0.1  # prior standard deviation of the sprockets' radius errors [-]
    far: bool = False  # true for poses far apart, where FAR_PRIORS hold

    @property
    def extras(self) -> dict[str, Extra]:
        """The parameters that don't belong to the law."""
        return {name: extra for name, extra in EXTRAS.items() if self.gyro or name not in GYRO}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters, ordered as in value arrays (p,)."""
        return (*self.family.names, *self.extras)

    def index(self, name: str) -> int:
        """Index of a parameter in value arrays (p,)."""
        return self.names.index(name)

    @property
    def limits(self) -> Array:
        """Lower limits, upper limits and scales of the parameters (3, p)."""
        extras = np.array([(e.low, e.high, e.scale) for e in self.extras.values()]).T
        return np.concatenate([self.family.limits(self.geometry.half_gauge), extras], axis=1)

    @property
    def prior(self) -> Array:
        """Prior standard deviations (p,); those of law parameters are too wide to matter with
        informative data.
        """
        half_gauge = self.geometry.half_gauge
        _, _, scale = self.family.limits(half_gauge)
        is_radius = np.array([name.startswith("radius_error") for name in self.family.names], bool)
        of_law = np.where(is_radius, self.radius_prior, 10 * scale)

        width = {name: extra.prior for name, extra in self.extras.items()}
        if self.far:
            width |= FAR_PRIORS
        of_extras = [
            width[name] * (half_gauge if extra.unit == "m" else 1.0)
            for name, extra in self.extras.items()
        ]
        return np.concatenate([of_law, of_extras])

    def path(self, values: Array, drives: Drives, free: np.ndarray) -> Path:
        """The sensor's path at the pose times for `values` (p,), with derivatives by the parameters
        `free` (f,).
        """
        # the turning centre's path, which depends on the law, the drift and the lag
        law_size = len(self.family.names)
        extra = dict(zip(self.extras, values[law_size:], strict=True))
        is_of_motion = (free < law_size) | np.isin(free, [self.index("drift"), self.index("lag")])
        motion, motion_slope = self._motion(values[:law_size], extra, drives, free[is_of_motion])
        time = drives.time + extra["clock_offset"]
        path = path_at(drives.edges, motion, motion_slope, time, drives.intervals(time))

        # its derivatives by all free parameters: a later clock is further along the path
        place_slope = np.zeros((len(free), len(time)), complex)
        heading_slope = np.zeros((len(free), len(time)))
        place_slope[is_of_motion] = path.place_slope
        heading_slope[is_of_motion] = path.heading_slope
        place_slope[free == self.index("clock_offset")] = path.velocity
        heading_slope[free == self.index("clock_offset")] = path.yaw_rate

        # the sensor, at the end of an arm that turns with the robot
        ahead = np.exp(1j * path.heading)
        arm = (extra["sensor_x"] + 1j * extra["sensor_y"]) * ahead
        place_slope += 1j * arm * heading_slope
        place_slope[free == self.index("sensor_x")] = ahead
        place_slope[free == self.index("sensor_y")] = 1j * ahead
        heading_slope[free == self.index("sensor_yaw")] = 1.0
        return Path(
            place=path.place + arm,
            heading=path.heading + extra["sensor_yaw"],
            place_slope=place_slope,
            heading_slope=heading_slope,
            velocity=path.velocity,
            yaw_rate=path.yaw_rate,
        )

    def gyro_turns(
        self, values: Array, drives: Drives, free: np.ndarray
    ) -> tuple[Array, Array, Array]:
        """Bias-free gyro turns (K,) up to each pose [rad], derivatives (f, K), and durations of
        readings (K,) [s].
        """
        assert drives.gyro is not None
        time = drives.time + values[self.index("clock_offset")]
        gyro_time, turned_sums, measured_sums = drives.gyro.T
        turned = np.interp(time, gyro_time, turned_sums)
        measured = np.interp(time, gyro_time, measured_sums)
        at_bias = self.index("gyro_bias")
        slope = np.where((free == at_bias)[:, None], -drives.time, 0.0)
        return turned - values[at_bias] * drives.time, slope, measured

    def _motion(
        self, values: Array, extra: Mapping[str, float], drives: Drives, free: np.ndarray
    ) -> tuple[Array, Array]:
        """Motion (3, M) in the encoder intervals, and its derivatives (3, f, M) by the parameters
        `free` (f,).
        """
        law_size = len(values)
        of_law = free[free < law_size]
        lag = extra["lag"]
        drift = extra["drift"]
        is_lag = free == self.index("lag")

        # forward speed and yaw rate (2, M), which follow the law's with a lag
        law = self.family.law(values, self.geometry)
        by_law = np.moveaxis(law.twist(drives.omega, self.geometry), -1, 0)
        v, w = _lagging(by_law, drives, lag)

        # their derivatives
        slope = np.zeros((3, len(free), len(drives.omega)))
        forward_slope, leftward_slope, yaw_slope = slope  # views
        if len(of_law):
            slopes = self.family.twist_slopes(values[None], drives.omega, self.geometry)[0]
            of_free = np.moveaxis(slopes[..., of_law], 0, -1)  # (2, f, M)
            lagging = _lagging(of_free, drives, lag)
            forward_slope[free < law_size] = lagging[0]
            yaw_slope[free < law_size] = lagging[1]
        if is_lag.any():
            later_v, later_w = _lagging(by_law, drives, lag + _LAG_STEP)
            forward_slope[is_lag] = (later_v - v) / _LAG_STEP
            yaw_slope[is_lag] = (later_w - w) / _LAG_STEP

        # the drift to the left, -c v w
        leftward_slope[:] = -drift * (v * yaw_slope + w * forward_slope)
        leftward_slope[free == self.index("drift")] = -v * w
        return np.stack([v, -drift * v * w, w]), slope


def _lagging(values: Array, drives: Drives, lag: float) -> Array:
    """Apply a first-order lag [s] to interval means (..., M); each drive starts in a settled
    state.

    In an interval of duration h with the constant input u, the output x approaches u. With
    k = e^(-h / lag), it ends at k x0 + (1 - k) u and has the mean u + (x0 - u) (lag / h) (1 - k),
    where x0 is its value at the end of the interval before. So the values at all ends solve a
    bidiagonal system of equations.
    """
    if lag <= 0:
        return values
    step = np.diff(drives.edges)
    begins = drives.begins
    kept = np.exp(-step / lag)

    # a drive begins with x0 = u
    driven = (1 - kept) * values
    driven[..., begins] += kept[begins] * values[..., begins]
    diagonal = np.ones(len(step))
    below = np.append(-kept[1:], 0.0)
    below[begins[1:] - 1] = 0.0
    rows = driven.reshape(-1, len(step))
    ends = scipy.linalg.solve_banded((1, 0), np.stack([diagonal, below]), rows.T)
    ends = ends.T.reshape(driven.shape)

    before = np.roll(ends, 1, axis=-1)
    before[..., begins] = values[..., begins]
    return values + (before - values) * ((lag / step) * (1 - kept))


@dataclass(frozen=True)
class Path:
    """A path at K times, with derivatives by f parameters; complex places are x + i y."""

    place: np.ndarray  # (K,) complex [m]
    heading: Array  # (K,) [rad]
    place_slope: np.ndarray  # (f, K) complex
    heading_slope: Array  # (f, K)
    velocity: np.ndarray  # (K,) velocity of the middle of the tracks, complex [m/s]
    yaw_rate: Array  # (K,) [rad/s]


def path_at(edges: Array, motion: Array, slope: Array, time: Array, row: np.ndarray) -> Path:
    """Path of a robot from the origin, at times `time` (K,), with motion at constant twists between
    `edges` (M + 1,).

    `motion` (3, M) has forward speeds, speeds to the left and yaw rates; `slope` (3, f, M) has the
    derivatives. `row` (K,) is the interval that contains each time, or the interval whose motion
    continues up to that time.
    """
    # headings and places at the edges
    step = np.diff(edges)
    edge_heading = _started(motion[2] * step)
    edge_heading_slope = _started(slope[2] * step)
    moved, moved_slope = _displaced(
        motion, slope, step, edge_heading[:-1], edge_heading_slope[:, :-1]
    )
    edge_place = _started(moved)
    edge_place_slope = _started(moved_slope)

    # from the edge before each time to that time
    rest = time - edges[row]
    motion_here = motion[:, row]
    slope_here = np.take(slope, row, axis=-1)
    begin_heading = edge_heading[row]
    begin_heading_slope = np.take(edge_heading_slope, row, axis=-1)
    beyond, beyond_slope = _displaced(
        motion_here, slope_here, rest, begin_heading, begin_heading_slope
    )

    forward_speed, leftward_speed, yaw_rate = motion_here
    heading = begin_heading + yaw_rate * rest
    return Path(
        place=edge_place[row] + beyond,
        heading=heading,
        place_slope=np.take(edge_place_slope, row, axis=-1) + beyond_slope,
        heading_slope=begin_heading_slope + slope_here[2] * rest,
        velocity=np.exp(1j * heading) * (forward_speed + 1j * leftward_speed),
        yaw_rate=yaw_rate,
    )


def _displaced(
    motion: Array, slope: Array, step: Array, heading: Array, heading_slope: Array
) -> tuple[np.ndarray, np.ndarray]:
    """World displacements (M,) for motions (3, M) that last `step` (M,) from headings (M,), and
    derivatives (f, M).

    A robot that turns by t on an arc of length a moves along its chord, which points along the mean
    heading and has the length a s with

        s = sin(t / 2) / (t / 2),    ds/dt = (cos(t / 2) - s) / t

    With the velocity u (forwards + i leftwards), the duration h and the mean heading m, the
    displacement is z = h s u e^(i m). It changes by

        dz = h s e^(i m) du + h u e^(i m) ds/dt dt + i z dm
    """
    velocity = motion[0] + 1j * motion[1]
    turn = motion[2] * step
    shortening = np.sinc(turn / (2 * np.pi))
    along = np.exp(1j * (heading + turn / 2)) * step
    moved = along * shortening * velocity
    if not slope.shape[1]:
        return moved, np.zeros((0, len(moved)), complex)

    # ds/dt; where the turn is small, s is 1 - t² / 24
    is_small = np.abs(turn) < _SMALL_TURN
    by_turn = (np.cos(turn / 2) - shortening) / np.where(is_small, 1.0, turn)
    by_turn = np.where(is_small, -turn / 12, by_turn)

    velocity_slope = slope[0] + 1j * slope[1]
    turn_slope = slope[2] * step
    moved_slope = (along * shortening) * velocity_slope
    moved_slope += (along * by_turn * velocity) * turn_slope
    moved_slope += (1j * moved) * (heading_slope + turn_slope / 2)
    return moved, moved_slope


def _started(increments: np.ndarray) -> np.ndarray:
    """Cumulative sums (..., M + 1) of increments (..., M), starting at zero."""
    sums = np.zeros((*increments.shape[:-1], increments.shape[-1] + 1), increments.dtype)
    np.cumsum(increments, axis=-1, out=sums[..., 1:])
    return sums
