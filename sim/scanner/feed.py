"""Scans of a fleet: rays, noise and limits of the laser range finder -> Scan."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from sim.fleet import Fleet
from sim.restorable import Restorable
from sim.robot.robot import SCANNED_GROUP
from sim.scanner.beams import Aim, echo, footprint, moved_back
from sim.scanner.obstacles import Obstacles
from sim.scanner.scanner import LaserScanner
from sim.seeds import generator
from trackslip.errors import require
from trackslip.kinematics import Array
from trackslip.localization.scan import Scan


class ScannerFeed(Restorable):
    """The scanners of a fleet: each robot is observed by its own LRF in its own world."""

    STATE = ("_random",)

    def __init__(
        self,
        scanner: LaserScanner,
        fleet: Fleet,
        generators: Sequence[np.random.Generator] | int = 0,
        obstacles: Obstacles | None = None,
        kept: bool = False,
        noise: ArrayLike | None = None,
    ) -> None:
        """Set up the scanner.

        Args:
            scanner: its properties.
            fleet: N robots.
            generators: one per robot, so that its noise doesn't depend on what else is simulated; or the seed of them.
            obstacles: in the field, the same for all robots; by default there are none.
            kept: whether logs have all ranges, also those that aren't the plate's; always for robots with contact
                sensors.
            noise: standard deviation of the ranges of each robot's scanner (N,); by default the scanner's [m].

        Raises:
            InvalidValueError: for a wrong number of generators, and an obstacle on the scanner.
        """
        if isinstance(generators, int):
            generators = [generator(generators, f"robot {k}") for k in range(fleet.size)]
        require(len(generators) == fleet.size, "generators", len(generators), f"{fleet.size}, one per robot")
        self._scanner, self._fleet = scanner, fleet
        self._random = [g.spawn(1)[0] for g in generators]
        every = np.broadcast_to(scanner.noise if noise is None else noise, (fleet.size,))
        self._scanners = [dataclasses.replace(scanner, noise=float(deviation)) for deviation in every]
        robot = fleet.robot
        x, y, self._heading = robot.lrf_mount
        self._origin = np.array([x, y, robot.lrf_height])
        self.kept = kept or robot.contact_sensors
        """True if logs have all ranges."""
        self.period = scanner.period
        """Time between scans [s]."""
        self.bearings = scanner.bearings
        """Directions (B,) of the beams in the LRF's frame [rad]."""
        direction = self._heading + self.bearings[:, None] + footprint(scanner.divergence)
        self._rays = np.stack([np.cos(direction), np.sin(direction), np.zeros_like(direction)], axis=-1)  # (B, K, 3)
        self._lag = scanner.lag
        obstacles = obstacles or Obstacles()
        obstacles.require_clear(self._origin[:2])
        self._walking = Obstacles(walkers=obstacles.walkers)
        standing = dataclasses.replace(obstacles, walkers=())
        self._standing = self._to_obstacles(standing, 0.0) if obstacles else None  # (B, K) [m], computed once
        # a plate moves for half the scan before the scan's time and half of it after: twice that is safe
        top_speed = fleet.drive.limit * robot.geometry.sprocket_radius
        self._reach = robot.plate_radius + top_speed * scanner.scan_duration
        self._aim: Aim | None = None
        self._aimed_rays: Array = np.empty((fleet.size, 0, 1, 3))  # (N, W, K, 3)
        self._aimed_origins: Array = np.empty((fleet.size, 0, 3))  # (N, W * K, 3)
        self._groups = (np.arange(6) == SCANNED_GROUP).astype(np.uint8)
        self._lrf = robot.model.body("lrf").id

    def restart(self, robots: np.ndarray, generators: Sequence[np.random.Generator]) -> None:
        """Restart the noise of some robots (R,), with one generator each."""
        for robot, g in zip(robots, generators, strict=True):
            (self._random[robot],) = g.spawn(1)

    def true_ranges(self) -> Array:
        """Ranges (N, B) without measurement errors, NaN where there is nothing [m]."""
        aim = self._aimed()
        plate = self._to_plates(aim)
        ranges = np.empty((self._fleet.size, len(self._rays)))
        if self._standing is None:
            ranges.fill(np.nan)
        else:
            around = np.fmin(self._standing, self._to_obstacles(self._walking, self._fleet.time))
            plate = np.fmin(plate, around[aim.beams])
            ranges[:] = echo(around)
        ranges.ravel()[aim.place] = echo(plate)
        return ranges

    def _aimed(self) -> Aim:
        """The beams to cast at the plates now."""
        centre = self._fleet.plate
        if self._aim is None or not self._aim.holds(centre):
            width = self._scanner.divergence
            self._aim = Aim.at(centre.copy(), self._origin, self._heading, self._reach, self.bearings, width)
            self._aimed_rays = self._rays[self._aim.beams]
            self._aimed_origins = np.empty(self._aimed_rays.shape).reshape(self._fleet.size, -1, 3)
            self._aimed_origins[:] = self._origin
        return self._aim

    def _to_plates(self, aim: Aim) -> Array:
        """Distances (N, W, K) along the rays of the selected beams, NaN for a miss [m]."""
        fleet, rays, origins = self._fleet, self._aimed_rays, self._aimed_origins
        if self._scanner.scan_duration > 0:
            origins, rays = moved_back(self._origin, rays, fleet.pose(), fleet.twist(), self._lag[aim.beams])
            origins = origins.reshape(fleet.size, -1, 3)
        distance, *_ = fleet.batch.ray(
            origins, rays.reshape(fleet.size, -1, 3), geomgroup=self._groups, bodyexclude=self._lrf
        )
        distance[distance < 0] = np.nan
        return distance.reshape(rays.shape[:-1])

    def _to_obstacles(self, obstacles: Obstacles, time: float) -> Array:
        """Distances (B, K) along the rays of all beams, in a scan at `time` [s], NaN for a miss [m]."""
        return obstacles.ranges(self._origin[:2], self._rays[..., :2], time + self._lag[:, None])

    def measure(self, true_ranges: Array) -> Array:
        """Measured ranges (N, ..., B) [m] of each robot's scanner, which has its own random numbers."""
        every = zip(self._scanners, true_ranges, self._random, strict=True)
        return np.stack([scanner.measure(ranges, random) for scanner, ranges, random in every])

    def scan(self, ranges: Array) -> Scan:
        """Ranges (..., B) [m] as a Scan of this LRF."""
        return self._scanner.scan(ranges, self._fleet.robot.lrf_mount)
