"""The laser range finder in front of a fleet: rays, noise, limits -> Scan."""

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
from trackslip.errors import InvalidValueError
from trackslip.kinematics import Array
from trackslip.localization.scan import Scan


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
        # (B, K) [m]: what stands is met once, for good
        self._standing = self._to_obstacles(obstacles.standing, 0.0) if obstacles else None
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
        if self._standing is None:
            ranges = np.full((self._fleet.size, len(self._rays)), np.nan)
        else:
            around = np.fmin(self._standing, self._to_obstacles(self._walking, self._fleet.time))
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

    def _to_obstacles(self, obstacles: Obstacles, time: float) -> Array:
        """Distances (B, K) along the rays of all beams, NaN for a miss, in the scan at a time [s] of the fleet [m]."""
        return self._within_reach(obstacles.ranges(self._origin[:2], self._rays[..., :2], time + self._lag[:, None]))

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
