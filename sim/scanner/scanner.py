"""The laser range finder (LRF): rays, noise, limits -> Scan."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sim.scanner.aim import Aim
from sim.scanner.footprint import echo, footprint
from sim.scanner.obstacles import Obstacles
from sim.scanner.scan_motion import moved_back
from trackslip.errors import InvalidValueError, require_at_most, require_non_negative, require_positive
from trackslip.kinematics import Array
from trackslip.localization.scan import Scan

if TYPE_CHECKING:
    from sim.fleet import Fleet

MAX_BEAMS = 20_000
"""Beams in a scan, at most."""
SCANNED_GROUP = 0
"""Geoms that the laser range finder sees."""
MIN_RATE = 5.0
"""Scans per second, at least [Hz]."""
MAX_ERROR = 0.5
"""Of a range, from any one cause [m]."""
MIN_STEP = 1e-6
"""Quantisation of ranges, at least [m]."""
MAX_BEAM = 0.1
"""Divergence, at most [rad]."""


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
    quantisation: float = 0.0
    """Ranges, noise included, are rounded to multiples of it; 0 for not at all [m]."""
    range_bias: float = 0.0
    """Error that all ranges share [m]."""
    divergence: float = 0.0
    """Angle by which a beam widens, 4.4 mrad for the LMS 200: its footprint mixes pixels at edges [rad]."""
    sweep_time: float = 0.0
    """Time from the first beam to the last, in the middle of which is the scan's own time [s]."""

    def __post_init__(self) -> None:
        for name in ("field_of_view", "resolution", "rate", "max_range"):
            require_positive(name, getattr(self, name))
        for name in ("noise", "quantisation", "divergence", "sweep_time"):
            require_non_negative(name, getattr(self, name))
        for name in ("noise", "quantisation"):
            require_at_most(name, getattr(self, name), MAX_ERROR, "m")
        if 0 < self.quantisation < MIN_STEP:
            raise InvalidValueError("quantisation", self.quantisation, f"0, or at least {MIN_STEP:g} m")
        require_at_most("divergence", self.divergence, MAX_BEAM, "rad")
        if not abs(self.range_bias) <= MAX_ERROR:
            raise InvalidValueError("range_bias", self.range_bias, f"from {-MAX_ERROR:g} to {MAX_ERROR:g} m")
        require_at_most("max_range", self.max_range, 1000.0, "m")
        if self.rate < MIN_RATE:
            raise InvalidValueError("rate", self.rate, f"at least {MIN_RATE:g} Hz")
        if self.field_of_view / self.resolution > MAX_BEAMS:
            raise InvalidValueError(
                "resolution", self.resolution, f"at least field_of_view / {MAX_BEAMS}: that many beams at most"
            )
        if self.field_of_view > 2 * np.pi or self.resolution >= self.field_of_view:
            raise InvalidValueError("field_of_view", self.field_of_view, "greater than the resolution, at most 2 pi")
        if not 0 <= self.dropout < 1:
            raise InvalidValueError("dropout", self.dropout, "at least 0 and less than 1")
        require_at_most("sweep_time", self.sweep_time, self.period, "s, the time between scans")

    @property
    def period(self) -> float:
        """Time between scans [s]."""
        return 1 / self.rate

    @property
    def bearings(self) -> Array:
        """Directions (B,) of the beams in the LRF's frame [rad]."""
        beams = round(self.field_of_view / self.resolution) + 1
        return (np.arange(beams) - (beams - 1) / 2) * self.resolution

    @property
    def lag(self) -> Array:
        """Times (B,) of the beams after the scan's [s]."""
        beams = len(self.bearings)
        return (np.arange(beams) / (beams - 1) - 0.5) * self.sweep_time

    @property
    def range_std(self) -> float:
        """Standard deviation of a range, from noise and rounding [m]."""
        return float(np.hypot(self.noise, self.quantisation / np.sqrt(12)))


class ScannerFeed:
    """The scanner in front of a fleet: every robot is watched by an LRF of its own, among obstacles of its own."""

    def __init__(
        self,
        scanner: LaserScanner,
        fleet: Fleet,
        generators: Sequence[np.random.Generator],
        obstacles: Obstacles | None = None,
    ) -> None:
        """`generators`: one for each robot, so that its noise doesn't depend on what else is simulated."""
        if len(generators) != fleet.size:
            raise InvalidValueError("generators", len(generators), f"{fleet.size}, one for each robot")
        self._scanner, self._fleet, self._obstacles = scanner, fleet, obstacles or Obstacles()
        self._noise, self._dropout = (list(g) for g in zip(*(g.spawn(2) for g in generators), strict=True))
        robot = fleet.robot
        x, y, heading = robot.lrf_mount
        self._heading = heading
        self._origin = np.array([x, y, robot.lrf_height])
        bearings = scanner.bearings
        direction = heading + bearings[:, None] + footprint(scanner.divergence)
        self._rays = np.stack([np.cos(direction), np.sin(direction), np.zeros_like(direction)], axis=-1)  # (B, K, 3)
        self._lag = scanner.lag
        # a plate moves for half the sweep after the scan's time and before it: as much again to spare
        top_speed = fleet.drive.limit * robot.geometry.sprocket_radius
        self._reach = robot.plate_radius + top_speed * scanner.sweep_time
        self._aim: Aim | None = None
        self._aimed_rays: Array = np.empty((fleet.size, 0, 1, 3))  # (N, W, K, 3)
        self._template = Scan(
            bearings,
            np.empty((0, len(bearings))),
            scanner.range_std,
            robot.lrf_mount,
            max_range=scanner.max_range,
            dropout=scanner.dropout,
        )
        self._groups = np.arange(6) == SCANNED_GROUP
        self._lrf = robot.model.body("lrf").id

    def restart(self, robots: np.ndarray, generators: Sequence[np.random.Generator]) -> None:
        """Give some robots (R,) new streams of noise."""
        for robot, g in zip(robots, generators, strict=True):
            self._noise[robot], self._dropout[robot] = g.spawn(2)

    @property
    def period(self) -> float:
        """Time between scans [s]."""
        return self._scanner.period

    @property
    def bearings(self) -> Array:
        """Directions (B,) of the beams in the LRF's frame [rad]."""
        return self._template.bearings

    def true_ranges(self) -> Array:
        """Ranges (N, B) of the echoes, without errors of measurement, NaN where nothing is within range [m]."""
        aim = self._aimed()
        plate = self._to_plates(aim)
        if not self._obstacles:
            ranges = np.full((self._fleet.size, len(self._rays)), np.nan)
        else:
            time = self._fleet.time + self._lag[:, None]
            around = self._within_reach(self._obstacles.ranges(self._origin[:2], self._rays[..., :2], time))  # (B, K)
            plate = np.fmin(plate, around[aim.beams])
            ranges = np.tile(echo(around), (self._fleet.size, 1))
        ranges.ravel()[aim.place] = echo(plate)
        return ranges

    def _aimed(self) -> Aim:
        """The beams to cast now."""
        centre = self._fleet.plate
        if self._aim is None or not self._aim.holds(centre):
            self._aim = Aim.at(
                centre.copy(),
                self._origin,
                self._heading,
                self._reach,
                self._template.bearings,
                self._scanner.divergence,
            )
            self._aimed_rays = self._rays[self._aim.beams]
        return self._aim

    def _to_plates(self, aim: Aim) -> Array:
        """Distances (N, W, K) along the rays of the beams aimed, NaN for a miss: one call for all robots [m]."""
        fleet, rays, origin = self._fleet, self._aimed_rays, self._origin
        if self._scanner.sweep_time > 0:
            origin, rays = moved_back(origin, rays, fleet.pose(), fleet.twist(), self._lag[aim.beams])
            origin = origin.reshape(fleet.size, -1, 3)
        distance, _ = fleet.batch.ray(
            origin, rays.reshape(fleet.size, -1, 3), geomgroup=self._groups, bodyexclude=self._lrf
        )
        distance[distance < 0] = np.nan
        return self._within_reach(distance.reshape(rays.shape[:-1]))

    def _within_reach(self, distance: Array) -> Array:
        """Distances with NaN for those beyond the scanner's reach, in place."""
        distance[distance > self._scanner.max_range] = np.nan
        return distance

    def measure(self, true_ranges: Array) -> Scan:
        """Scans (N, T, B) as measured, of true ranges (N, T, B): the next T of each robot's stream."""
        n, t, beams = true_ranges.shape
        ranges = np.empty_like(true_ranges)
        for k in range(n):  # a stream of random numbers per robot
            np.multiply(self._noise[k].standard_normal((t, beams)), self._scanner.noise, out=ranges[k])
        ranges += true_ranges
        ranges += self._scanner.range_bias
        if self._scanner.quantisation > 0:
            ranges = np.round(ranges / self._scanner.quantisation) * self._scanner.quantisation
        if self._scanner.dropout > 0:
            for k in range(n):
                ranges[k][self._dropout[k].random((t, beams)) < self._scanner.dropout] = np.nan
        return self.scan(ranges)

    def scan(self, ranges: Array) -> Scan:
        """Ranges (..., B) as a Scan of this LRF."""
        return dataclasses.replace(self._template, ranges=ranges)
