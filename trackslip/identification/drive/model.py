"""The model of a drive: a law, and how the sensor, its clock and the robot's lag distort what is measured.

Parameters are those of the law, followed by EXTRAS:

- sensor_x: how far ahead of the turning centre the sensor sits [m]. The centre may lie ahead of or behind the middle of
  the tracks; the two can't be told apart.
- sensor_y: how far to the left of the middle the sensor sits [m].
- drift: c, outward drift in turns, a lateral speed of -c v w [s].
- clock_offset: tau, encoder clock minus pose clock [s]: encoders show at stamp t + tau what poses show at stamp t.
- sensor_yaw: heading of the sensor minus heading of the robot [rad].
- lag: time constant with which the motion follows the belts [s].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from trackslip.identification.drive.drives import Drive
from trackslip.identification.drive.law_twist import twists
from trackslip.identification.drive.reckoning import path_at, quarter, rotated
from trackslip.kinematics import Array, RobotGeometry
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
    "sensor_y": Extra("m", 0.02, 0.5, -10.0, 10.0, "sensor to the left of the middle"),
    "drift": Extra("s", 0.05, 0.3, -5.0, 5.0, "outward drift c in turns"),
    "clock_offset": Extra("s", 0.05, 2.0, -10.0, 10.0, "encoder clock minus pose clock"),
    "sensor_yaw": Extra("rad", 0.02, 1.0, -4.0, 4.0, "heading of the sensor minus heading of the robot"),
    "lag": Extra("s", 0.05, 0.1, 0.0, 2.0, "lag of the motion behind the belts"),
}
_LAG_DIFFERENCE = 1e-3  # [s]


@dataclass(frozen=True)
class Steps:
    """Motion of the turning centre between neighbouring nodes, by the law."""

    motion: Array  # (K - 1, 3): displacement in the frame of the first node [m, m], turn [rad]
    slope: Array  # (K - 1, 3, p) by all parameters; those of the sensor's place and yaw have none
    distance: Array  # (K - 1,) mean way of the two belts [m]
    path: Array  # (K, 3) of the turning centre from the origin [m, m, rad]


@dataclass(frozen=True)
class DriveModel:
    """A family of laws with EXTRAS, for a robot."""

    family: LawFamily
    geometry: RobotGeometry

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters, in the order of their values in arrays (p,)."""
        return (*self.family.names, *EXTRAS)

    def index(self, name: str) -> int:
        """Place of a parameter in arrays of values."""
        return self.names.index(name)

    @property
    def limits(self) -> Array:
        """Lower limits, upper limits and scales (3, p)."""
        extras = np.array([(e.low, e.high, e.scale) for e in EXTRAS.values()]).T
        return np.concatenate([self.family.limits(self.geometry.half_gauge), extras], axis=1)

    @property
    def prior(self) -> Array:
        """Standard deviations (p,) of the priors; the law's are too wide to matter where data say anything."""
        scale = self.family.limits(self.geometry.half_gauge)[2]
        return np.concatenate([10 * scale, [extra.prior for extra in EXTRAS.values()]])

    def steps(self, values: Array, drive: Drive) -> Steps:
        """Dead reckoning of a drive with parameter values (p,)."""
        count, law = len(values), len(self.family.names)
        extra = dict(zip(EXTRAS, values[law:], strict=True))
        at = {name: law + k for k, name in enumerate(EXTRAS)}
        twist, by_law = twists(self.family, values[:law], drive.omega, self.geometry)
        slope = np.zeros((len(twist), 3, count))
        slope[:, [0, 2], :law] = by_law
        lag = extra["lag"]
        lagged = _lagging(twist, drive.edges, lag)
        slope[:, [0, 2], at["lag"]] = (_lagging(twist, drive.edges, lag + _LAG_DIFFERENCE) - lagged) / _LAG_DIFFERENCE
        if lag > 0 and law:
            flat = _lagging(by_law.reshape(len(twist), -1), drive.edges, lag)
            slope[:, [0, 2], :law] = flat.reshape(by_law.shape)
        v, w = lagged.T
        slope[:, 1] = -extra["drift"] * (v[:, None] * slope[:, 2] + w[:, None] * slope[:, 0])
        slope[:, 1, at["drift"]] -= v * w
        motion = np.stack([v, -extra["drift"] * v * w, w], axis=-1)
        path = path_at(drive.edges, motion, slope, drive.time + extra["clock_offset"])
        path.position_slope[..., at["clock_offset"]] += path.velocity[:, :2]
        path.heading_slope[..., at["clock_offset"]] += path.velocity[:, 2]
        back = -path.heading[:-1]
        moved = rotated(back, np.diff(path.position, axis=0))
        by_all = rotated(back, np.diff(path.position_slope, axis=0))
        by_all = by_all - quarter(moved, 1)[..., None] * path.heading_slope[:-1, None, :]
        return Steps(
            np.column_stack([moved, np.diff(path.heading)]),
            np.concatenate([by_all, np.diff(path.heading_slope, axis=0)[:, None]], axis=1),
            self._distance(drive, extra["clock_offset"]),
            np.column_stack([path.position, path.heading]),
        )

    def sensor_path(self, values: Array, drive: Drive) -> Array:
        """Positions of the sensor and headings of the robot (K, 3) by dead reckoning, from anywhere."""
        path = self.steps(values, drive).path
        lever = values[[self.index("sensor_x"), self.index("sensor_y")]]
        path[:, :2] += rotated(path[:, 2], np.broadcast_to(lever, (len(path), 2)))
        return path

    def _distance(self, drive: Drive, offset: float) -> Array:
        """Mean way (K - 1,) of the two belts between nodes [m]."""
        speed = self.geometry.sprocket_radius * np.abs(drive.omega).mean(axis=1)
        ways = np.concatenate([[0.0], np.cumsum(speed * np.diff(drive.edges))])
        return np.diff(np.interp(drive.time + offset, drive.edges, ways))


def _lagging(values: Array, edges: Array, lag: float) -> Array:
    """Means (M, n) in the intervals of a first-order lag [s] behind values (M, n), which starts settled."""
    if lag <= 0:
        return values
    step = np.diff(edges)
    kept = np.exp(-step / lag)
    bands = np.stack([np.ones(len(step)), np.append(-kept[1:], 0.0)])
    driven = (1 - kept)[:, None] * values
    driven[0] += kept[0] * values[0]
    ends = scipy.linalg.solve_banded((1, 0), bands, driven)
    begins = np.concatenate([values[:1], ends[:-1]])
    return values + (begins - values) * ((lag / step) * (1 - kept))[:, None]
