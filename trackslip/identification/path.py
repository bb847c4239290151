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
FAR_PRIORS: Final = {"sensor_x": 0.05, "sensor_y": 0.05, "sensor_yaw": 0.02}
"""Prior standard deviations for drives with few poses, far apart, as in EXTRAS: a sensor that may
be anywhere would take up the effects of unequal radii.
"""
GYRO: Final = ("gyro_bias", "gyro_scale")  # the last of EXTRAS, for drives with a gyro


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
        scale, b = self.family.limits(self.geometry.half_gauge)[2], self.geometry.half_gauge
        width = {name: extra.prior for name, extra in self.extras.items()}
        if self.far:
            width |= FAR_PRIORS
        extras = [
            width[name] * (b if extra.unit == "m" else 1.0) for name, extra in self.extras.items()
        ]
        radii = np.array([name.startswith("radius_error") for name in self.family.names], bool)
        return np.concatenate([np.where(radii, self.radius_prior, 10 * scale), extras])

    def path(self, values: Array, drives: Drives, free: np.ndarray) -> Path:
        """The sensor's path at the pose times for `values` (p,), with derivatives by the parameters
        `free` (f,).
        """
        law = len(self.family.names)
        extra = dict(zip(self.extras, values[law:], strict=True))
        moving = (free < law) | np.isin(free, [self.index("drift"), self.index("lag")])
        motion, slope = self._motion(values[:law], extra, drives, free[moving])
        time = drives.time + extra["clock_offset"]
        path = path_at(drives.edges, motion, slope, time, drives.intervals(time))
        ahead = np.exp(1j * path.heading)
        arm = (extra["sensor_x"] + 1j * extra["sensor_y"]) * ahead
        place_slope, heading_slope = (
            np.zeros((len(free), len(time)), complex),
            np.zeros((len(free), len(time))),
        )
        place_slope[moving], heading_slope[moving] = path.place_slope, path.heading_slope
        clock = free == self.index("clock_offset")
        place_slope[clock], heading_slope[clock] = path.velocity, path.yaw_rate
        place_slope += 1j * arm * heading_slope
        place_slope[free == self.index("sensor_x")] = ahead
        place_slope[free == self.index("sensor_y")] = 1j * ahead
        heading_slope[free == self.index("sensor_yaw")] = 1.0
        place, heading = path.place + arm, path.heading + extra["sensor_yaw"]
        return Path(place, heading, place_slope, heading_slope, path.velocity, path.yaw_rate)

    def gyro_turns(
        self, values: Array, drives: Drives, free: np.ndarray
    ) -> tuple[Array, Array, Array]:
        """Bias-free gyro turns (K,) up to each pose [rad], derivatives (f, K), and durations of
        readings (K,) [s].
        """
        assert drives.gyro is not None
        time = drives.time + values[self.index("clock_offset")]
        turned, measured = (np.interp(time, drives.gyro[:, 0], sums) for sums in drives.gyro.T[1:])
        at_bias = self.index("gyro_bias")
        slope = np.where((free == at_bias)[:, None], -drives.time, 0.0)
        return turned - values[at_bias] * drives.time, slope, measured

    def _motion(
        self, values: Array, extra: Mapping[str, float], drives: Drives, free: np.ndarray
    ) -> tuple[Array, Array]:
        """Motion (3, M) in the encoder intervals, and its derivatives (3, f, M) by the parameters
        `free` (f,).
        """
        lag, drift, of_law = extra["lag"], extra["drift"], free[free < len(values)]
        belts = np.moveaxis(
            self.family.law(values, self.geometry).twist(drives.omega, self.geometry), -1, 0
        )
        v, w = motion = _lagging(belts, drives, lag)
        slope = np.zeros((3, len(free), len(drives.omega)))
        if len(of_law):
            by_law = self.family.twist_slopes(values[None], drives.omega, self.geometry)[0]
            slope[::2, free < len(values)] = _lagging(
                np.moveaxis(by_law[..., of_law], 0, -1), drives, lag
            )
        if (at_lag := free == self.index("lag")).any():
            change = 1e-3  # [s], small relative to any noticeable lag
            slope[::2, at_lag] = ((_lagging(belts, drives, lag + change) - motion) / change)[
                :, None
            ]
        slope[1] = -drift * (v * slope[2] + w * slope[0])
        slope[1, free == self.index("drift")] = -v * w
        return np.stack([v, -drift * v * w, w]), slope


def _lagging(values: Array, drives: Drives, lag: float) -> Array:
    """Apply a first-order lag [s] to interval means (..., M); each drive starts in a settled
    state.
    """
    if lag <= 0:
        return values
    step, begins = np.diff(drives.edges), drives.begins
    kept = np.exp(-step / lag)
    driven = (1 - kept) * values
    driven[..., begins] += kept[begins] * values[..., begins]
    bands = np.stack([np.ones(len(step)), np.append(-kept[1:], 0.0)])
    bands[1, begins[1:] - 1] = 0.0
    ends = scipy.linalg.solve_banded((1, 0), bands, driven.reshape(-1, len(step)).T).T.reshape(
        driven.shape
    )
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
    step = np.diff(edges)
    turned, turned_slope = _started(motion[2] * step), _started(slope[2] * step)
    moved, moved_slope = _displaced(motion, slope, step, turned[:-1], turned_slope[:, :-1])
    rest, here, here_slope = time - edges[row], motion[:, row], np.take(slope, row, axis=-1)
    heading, heading_slope = turned[row], np.take(turned_slope, row, axis=-1)
    beyond, beyond_slope = _displaced(here, here_slope, rest, heading, heading_slope)
    heading = heading + here[2] * rest
    return Path(
        _started(moved)[row] + beyond,
        heading,
        np.take(_started(moved_slope), row, axis=-1) + beyond_slope,
        heading_slope + here_slope[2] * rest,
        np.exp(1j * heading) * (here[0] + 1j * here[1]),
        here[2],
    )


def _displaced(
    motion: Array, slope: Array, step: Array, heading: Array, heading_slope: Array
) -> tuple[np.ndarray, np.ndarray]:
    """World displacements (M,) for motions (3, M) that last `step` (M,) from headings (M,), and
    derivatives (f, M).

    An arc's chord points along the mean heading. It is sin(t/2) / (t/2) times as long as the arc,
    where t is the turn.
    """
    turn = motion[2] * step
    chord = np.sinc(turn / (2 * np.pi))
    ahead = np.exp(1j * (heading + turn / 2)) * step
    moved = ahead * chord * (motion[0] + 1j * motion[1])
    if not slope.shape[1]:
        return moved, np.zeros((0, len(moved)), complex)
    small = np.abs(turn) < 1e-4  # where the chord is 1 - t² / 24
    shorter = np.where(small, -turn / 12, (np.cos(turn / 2) - chord) / np.where(small, 1.0, turn))
    turn_slope = slope[2] * step
    moved_slope = (ahead * chord) * (slope[0] + 1j * slope[1])
    moved_slope += (ahead * shorter * (motion[0] + 1j * motion[1])) * turn_slope
    moved_slope += (1j * moved) * (heading_slope + turn_slope / 2)
    return moved, moved_slope


def _started(increments: np.ndarray) -> np.ndarray:
    """Cumulative sums (..., M + 1) of increments (..., M), starting at zero."""
    sums = np.zeros((*increments.shape[:-1], increments.shape[-1] + 1), increments.dtype)
    np.cumsum(increments, axis=-1, out=sums[..., 1:])
    return sums
