"""Scans of a fleet: rays, noise and limits of the laser range finder -> Scan."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from sim.fleet import Fleet
from sim.robot.robot import SCANNED_GROUP
from sim.scanner.aim import Aim
from sim.scanner.footprint import echo, footprint
from sim.scanner.obstacles import Obstacles
from sim.scanner.scan_motion import moved_back
from sim.scanner.scanner import LaserScanner
from sim.seeds import generator
from trackslip.errors import InvalidValueError
from trackslip.kinematics import Array
from trackslip.localization.scan import Scan


class ScannerFeed:
    """The scanner in front of a fleet: every robot is observed by its own LRF, in its own world."""

    def __init__(
        self,
        scanner: LaserScanner,
        fleet: Fleet,
        generators: Sequence[np.random.Generator] | int = 0,
        obstacles: Obstacles | None = None,
    ) -> None:
        """Set up the scanner.

        Args:
            scanner: its properties.
            fleet: N robots.
            generators: one per robot, so that its noise doesn't depend on what else is simulated; or the seed of them.
            obstacles: in the field, the same for all robots; by default there are none.

        Raises:
            InvalidValueError: for a wrong number of generators, and an obstacle on the scanner.
        """
        if isinstance(generators, int):
            generators = [generator(generators, f"robot {k}") for k in range(fleet.size)]
        if len(generators) != fleet.size:
            raise InvalidValueError("generators", len(generators), f"{fleet.size}, one per robot")
        self._scanner, self._fleet = scanner, fleet
        self._noise, self._dropout = (list(g) for g in zip(*(g.spawn(2) for g in generators), strict=True))
        robot = fleet.robot
        x, y, heading = robot.lrf_mount
        self._heading = heading
        self._origin = np.array([x, y, robot.lrf_height])
        bearings = scanner.bearings
        direction = heading + bearings[:, None] + footprint(scanner.divergence)
        self._rays = np.stack([np.cos(direction), np.sin(direction), np.zeros_like(direction)], axis=-1)  # (B, K, 3)
        self._lag = scanner.lag
        obstacles = obstacles or Obstacles()
        obstacles.require_clear(self._origin[:2])
        self._walking = obstacles.walking
        # (B, K) [m], computed once
        self._standing = self._to_obstacles(obstacles.standing, 0.0) if obstacles else None
        # a plate moves for half the scan before the scan's time and half of it after: twice that is safe
        top_speed = fleet.drive.limit * robot.geometry.sprocket_radius
        self._reach = robot.plate_radius + top_speed * scanner.scan_duration
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
        """Restart the noise of some robots (R,), with one generator each."""
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
        """Ranges (N, B) without measurement errors, NaN where nothing is within reach [m]."""
        aim = self._aimed()
        plate = self._to_plates(aim)
        if self._standing is None:
            ranges = np.full((self._fleet.size, len(self._rays)), np.nan)
        else:
            around = np.fmin(self._standing, self._to_obstacles(self._walking, self._fleet.time))
            plate = np.fmin(plate, around[aim.beams])
            ranges = np.tile(echo(around), (self._fleet.size, 1))
        ranges.ravel()[aim.place] = echo(plate)
        return ranges

    def _aimed(self) -> Aim:
        """The beams to cast at the plates now."""
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
        """Distances (N, W, K) along the rays of the selected beams, NaN for a miss [m]."""
        fleet, rays, origin = self._fleet, self._aimed_rays, self._origin
        if self._scanner.scan_duration > 0:
            origin, rays = moved_back(origin, rays, fleet.pose(), fleet.twist(), self._lag[aim.beams])
            origin = origin.reshape(fleet.size, -1, 3)
        distance, _ = fleet.batch.ray(
            origin, rays.reshape(fleet.size, -1, 3), geomgroup=self._groups, bodyexclude=self._lrf
        )
        distance[distance < 0] = np.nan
        return self._within_reach(distance.reshape(rays.shape[:-1]))

    def _to_obstacles(self, obstacles: Obstacles, time: float) -> Array:
        """Distances (B, K) along the rays of all beams, in a scan at `time` [s], NaN for a miss [m]."""
        return self._within_reach(obstacles.ranges(self._origin[:2], self._rays[..., :2], time + self._lag[:, None]))

    def _within_reach(self, distance: Array) -> Array:
        """Distances, set to NaN in place where they are beyond the scanner's reach."""
        distance[distance > self._scanner.max_range] = np.nan
        return distance

    def measure(self, true_ranges: Array) -> Scan:
        """Add measurement errors to true ranges (N, T, B) [m]: the next T scans of each robot."""
        n, t, beams = true_ranges.shape
        ranges = np.empty_like(true_ranges)
        for k in range(n):  # each robot has its own stream of random numbers
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
        """Ranges (..., B) [m] as a Scan of this LRF."""
        return dataclasses.replace(self._template, ranges=ranges)
