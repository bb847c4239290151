"""Scans of a fleet: rays, noise and limits of the laser range finder -> Scan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from sim.fleet import Fleet
from sim.restorable import Restorable
from sim.robot.robot import SCANNED_GROUP
from sim.scanner.scanner import LaserScanner, Obstacles
from sim.seeds import generator
from trackslip.errors import require
from trackslip.kinematics import Array, wrap_angle
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
        self._scanners = [replace(scanner, noise=float(deviation)) for deviation in every]
        robot = fleet.robot
        x, y, self._heading = robot.lrf_mount
        self._origin = np.array([x, y, robot.lrf_height])
        self.kept = kept or robot.contact_sensors
        """True if logs have all ranges."""
        self.period = scanner.period
        """Time between scans [s]."""
        self.bearings = scanner.bearings
        """Directions (B,) of the beams in the LRF's frame [rad]."""
        direction = self._heading + self.bearings
        self._rays = np.stack([np.cos(direction), np.sin(direction), np.zeros_like(direction)], axis=-1)  # (B, 3)
        obstacles = obstacles or Obstacles()
        obstacles.require_clear(self._origin[:2])
        self._around = obstacles.ranges(self._origin[:2], self._rays[:, :2])  # (B,) [m]
        self._groups = (np.arange(6) == SCANNED_GROUP).astype(np.uint8)
        self._lrf = robot.model.body("lrf").id

    def restart(self, robots: np.ndarray, generators: Sequence[np.random.Generator]) -> None:
        """Restart the noise of some robots (R,), with one generator each."""
        for robot, g in zip(robots, generators, strict=True):
            (self._random[robot],) = g.spawn(1)

    def true_ranges(self) -> Array:
        """Ranges (N, B) without measurement errors, NaN where there is nothing [m]."""
        beams = self._beams()
        rays = self._rays[beams]
        origins = np.tile(self._origin, (*beams.shape, 1))
        distance, *_ = self._fleet.batch.ray(origins, rays, geomgroup=self._groups, bodyexclude=self._lrf)
        distance[distance < 0] = np.nan
        ranges = np.tile(self._around, (self._fleet.size, 1))
        np.put_along_axis(ranges, beams, np.fmin(distance, self._around[beams]), axis=1)
        return ranges

    def _beams(self) -> np.ndarray:
        """The beams (N, W) that can hit the plates, whatever their headings; as many for every robot."""
        x, y = (self._fleet.plate - self._origin)[:, :2].T
        radius, distance = self._fleet.robot.plate_radius, np.hypot(x, y)
        bearing = wrap_angle(np.arctan2(y, x) - self._heading)
        spread = np.where(distance > radius, np.arcsin(radius / np.maximum(distance, radius)), np.pi)
        edges = np.stack([bearing - spread, bearing + spread])
        edges[:, np.abs(bearing) + spread > np.pi] = [[-np.inf], [np.inf]]  # behind the scanner, where bearings wrap
        last, first = len(self.bearings) - 1, self.bearings[0]
        low, high = np.clip((edges - first) * last / (self.bearings[-1] - first), 0, last)
        begin = np.floor(low).astype(int)
        count = min(int((np.ceil(high) - begin).max()), last) + 1
        return np.minimum(begin, last + 1 - count)[:, None] + np.arange(count)

    def measure(self, true_ranges: Array) -> Array:
        """Measured ranges (N, ..., B) [m] of each robot's scanner, which has its own random numbers."""
        every = zip(self._scanners, true_ranges, self._random, strict=True)
        return np.stack([scanner.measure(ranges, random) for scanner, ranges, random in every])

    def scan(self, ranges: Array) -> Scan:
        """Ranges (..., B) [m] as a Scan of this LRF."""
        return self._scanner.scan(ranges, self._fleet.robot.lrf_mount)
