"""The laser range finder (LRF): rays, noise, limits -> Scan."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from trackslip.errors import InvalidValueError, require_at_most, require_non_negative, require_positive
from trackslip.kinematics import Array, wrap_angle
from trackslip.scan import Scan

if TYPE_CHECKING:
    from sim.fleet import Fleet

_SLACK = 0.2  # around the plate, so that the beams to cast needn't be chosen anew for every scan [m]
MOST_BEAMS = 20_000
"""Beams in a scan, at most."""
SCANNED_GROUP = 0
"""Geoms that the laser range finder sees."""
LOWEST_RATE = 5.0
"""Scans per second, at least [Hz]."""


@dataclass(frozen=True)
class LaserScanner:
    """A line scanner in the manner of the SICK LMS 200; the paper doesn't name its own."""

    field_of_view: float = float(np.pi)
    """Angle between the first and the last beam [rad]."""
    resolution: float = float(np.radians(0.25))
    """Angle between neighbouring beams [rad]."""
    rate: float = 20.0
    """Scans per second [Hz]."""
    noise: float = 0.005
    """Standard deviation of a range [m]."""
    max_range: float = 20.0
    """Beyond it nothing comes back [m]."""
    dropout: float = 0.0
    """Probability that a beam doesn't come back though it hit something [-]."""

    def __post_init__(self) -> None:
        for name in ("field_of_view", "resolution", "rate", "max_range"):
            require_positive(name, getattr(self, name))
        require_non_negative("noise", self.noise)
        require_at_most("noise", self.noise, 0.5, "m")
        require_at_most("max_range", self.max_range, 1000.0, "m")
        if self.rate < LOWEST_RATE:
            raise InvalidValueError("rate", self.rate, f"at least {LOWEST_RATE:g} Hz")
        if self.field_of_view / self.resolution > MOST_BEAMS:
            raise InvalidValueError(
                "resolution", self.resolution, f"at least field_of_view / {MOST_BEAMS}: that many beams at most"
            )
        if self.field_of_view > 2 * np.pi or self.resolution >= self.field_of_view:
            raise InvalidValueError("field_of_view", self.field_of_view, "greater than the resolution, at most 2 pi")
        if not 0 <= self.dropout < 1:
            raise InvalidValueError("dropout", self.dropout, "at least 0 and less than 1")

    @property
    def period(self) -> float:
        """Time between scans [s]."""
        return 1 / self.rate

    @property
    def bearings(self) -> Array:
        """Directions (B,) of the beams in the LRF's frame [rad]."""
        beams = round(self.field_of_view / self.resolution) + 1
        return (np.arange(beams) - (beams - 1) / 2) * self.resolution


@dataclass(frozen=True)
class _Aim:
    """The beams worth casting: nothing but the plate stops a beam, so those that pass it by needn't be."""

    centre: Array  # (N, 3) of the plates, when these beams were chosen [m]
    rays: Array  # (N, W, 3) their directions
    place: np.ndarray  # (N, W) where they are among the N x B of all


class ScannerFeed:
    """The scanner in front of a fleet: every robot is watched by an LRF of its own."""

    def __init__(self, scanner: LaserScanner, fleet: Fleet, generators: Sequence[np.random.Generator]) -> None:
        """`generators`: one for each robot, so that its noise doesn't depend on what else is simulated."""
        if len(generators) != fleet.size:
            raise InvalidValueError("generators", len(generators), f"{fleet.size}, one for each robot")
        self._scanner, self._fleet = scanner, fleet
        self._noise, self._dropout = zip(*(g.spawn(2) for g in generators), strict=True)
        robot = fleet.robot
        x, y, heading = robot.lrf_mount
        self._heading = heading
        self._origin = np.array([x, y, robot.lrf_height])
        bearings = scanner.bearings
        direction = heading + bearings
        self._rays = np.column_stack([np.cos(direction), np.sin(direction), np.zeros_like(direction)])
        self._aim: _Aim | None = None
        self._template = Scan(
            bearings,
            np.empty((0, len(bearings))),
            scanner.noise,
            robot.lrf_mount,
            max_range=scanner.max_range,
            dropout=scanner.dropout,
        )
        self._groups = np.arange(6) == SCANNED_GROUP
        self._lrf = robot.model.body("lrf").id

    @property
    def period(self) -> float:
        """Time between scans [s]."""
        return self._scanner.period

    @property
    def bearings(self) -> Array:
        """Directions (B,) of the beams in the LRF's frame [rad]."""
        return self._template.bearings

    def true_ranges(self) -> Array:
        """Ranges (N, B) without noise or dropouts, NaN where nothing is within range: one call for all robots."""
        centre = self._fleet.plate
        if self._aim is None or np.abs(centre - self._aim.centre).max() > _SLACK / 2:
            self._aim = self._aim_at(centre.copy())
        batch, aim = self._fleet.batch, self._aim
        distance, _ = batch.ray(self._origin, aim.rays, geomgroup=self._groups, bodyexclude=self._lrf)
        distance[(distance < 0) | (distance > self._scanner.max_range)] = np.nan
        ranges = np.full((self._fleet.size, len(self._rays)), np.nan)
        ranges.ravel()[aim.place] = distance
        return ranges

    def _aim_at(self, centre: Array) -> _Aim:
        """The beams that can meet plates whose middles stay near `centre` (N, 3), whatever their headings."""
        radius = self._fleet.robot.plate_radius + _SLACK
        x, y = (centre - self._origin)[:, :2].T
        distance = np.hypot(x, y)
        bearing = wrap_angle(np.arctan2(y, x) - self._heading)
        spread = np.where(distance > radius, np.arcsin(np.minimum(radius / np.maximum(distance, radius), 1.0)), np.pi)
        last = len(self._rays) - 1
        first_bearing, step = self._template.bearings[0], self._scanner.resolution
        low, high = ((edge - first_bearing) / step for edge in (bearing - spread, bearing + spread))
        around = np.abs(bearing) + spread > np.pi  # behind the scanner, where the bearing jumps
        low, high = np.where(around, 0, np.clip(low, 0, last)), np.where(around, last, np.clip(high, 0, last))
        first = np.floor(low).astype(int)
        count = min(int((np.ceil(high) - first).max()), last) + 1
        beams = np.minimum(first, last + 1 - count)[:, None] + np.arange(count)  # (N, W)
        robots = np.arange(len(centre))[:, None]
        return _Aim(centre, self._rays[beams], robots * len(self._rays) + beams)

    def measure(self, true_ranges: Array) -> Scan:
        """Scans (N, T, B) with noise and dropouts of true ranges (N, T, B): the next T of each robot's stream."""
        n, t, beams = true_ranges.shape
        ranges = np.empty_like(true_ranges)
        for k in range(n):  # a stream of random numbers per robot
            np.multiply(self._noise[k].standard_normal((t, beams)), self._scanner.noise, out=ranges[k])
        ranges += true_ranges
        if self._scanner.dropout > 0:
            for k in range(n):
                ranges[k][self._dropout[k].random((t, beams)) < self._scanner.dropout] = np.nan
        return self.scan(ranges)

    def scan(self, ranges: Array) -> Scan:
        """Ranges (..., B) as a Scan of this LRF."""
        return dataclasses.replace(self._template, ranges=ranges)
