"""Scans of a fleet, from the rays, noise and limits of the laser range finder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from sim.common.seeds import generator
from sim.fleet.fleet import Fleet
from sim.robot.robot import SCANNED_GROUP
from sim.scanner.scanner import LaserScanner, Obstacles
from trackslip.arguments import checks_arguments
from trackslip.errors import require
from trackslip.kinematics import Array, wrap_angle
from trackslip.localization.scan import Scan
from trackslip.restorable import Restorable

_SLACK: Final = 0.2  # margin around the plate, within which beams are not selected again [m]


@dataclass(frozen=True)
class _Aim:
    """The beams that can hit plates close to `centre` at any heading; their number W is the same
    for all robots.
    """

    centre: Array  # (N, 3) centres of the plates at the time of selection [m]
    beams: np.ndarray  # (N, W) indices of the selected beams among all B beams

    @classmethod
    def at(
        cls, centre: Array, origin: Array, heading: float, radius: float, bearings: Array
    ) -> _Aim:
        """Select the beams that can hit plates around `centre` (N, 3) [m].

        The beams start at `origin` (3,) [m]; their `bearings` (B,) relative to the world direction
        `heading` ascend in equal steps [rad]. All points of a plate are within `radius` from its
        centre [m].
        """
        # bearings of the circles in which the plates are
        radius += _SLACK
        x, y = (centre - origin)[:, :2].T
        distance = np.hypot(x, y)
        bearing = wrap_angle(np.arctan2(y, x) - heading)
        sine = np.minimum(radius / np.maximum(distance, radius), 1.0)
        half_width = np.where(distance > radius, np.arcsin(sine), np.pi)

        # as indices of beams; circles behind the scanner, where bearings wrap, take all beams
        last = len(bearings) - 1
        step = (bearings[-1] - bearings[0]) / last
        low = np.clip((bearing - half_width - bearings[0]) / step, 0, last)
        high = np.clip((bearing + half_width - bearings[0]) / step, 0, last)
        wraps = np.abs(bearing) + half_width > np.pi
        low = np.where(wraps, 0, low)
        high = np.where(wraps, last, high)

        # as many beams for each robot as the widest circle needs
        first = np.floor(low).astype(int)
        count = min(int((np.ceil(high) - first).max()), last) + 1
        first = np.minimum(first, last + 1 - count)
        return cls(centre, first[:, None] + np.arange(count))

    def holds(self, centre: Array) -> bool:
        """Whether the selection is still valid for plates around `centre` (N, 3) [m]."""
        return bool(np.abs(centre - self.centre).max() <= _SLACK / 2)


@checks_arguments
class ScannerFeed(Restorable):
    """The scanners of a fleet: each robot is observed by its own laser range finder (LRF) in its
    own world.
    """

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
        """Set up the scanners.

        Args:
            scanner: properties of all scanners.
            fleet: N robots.
            generators: one per robot, so that a robot's noise doesn't depend on the other robots;
                or a seed for them.
            obstacles: obstacles around every robot; by default none.
            kept: whether logs have all ranges, not only those on the plate; always true for robots
                with contact sensors.
            noise: standard deviation of ranges for each robot's scanner (N,); by default the noise
                of `scanner` [m].

        Raises:
            InvalidValueError: for a wrong number of generators, negative noise, and an obstacle at
                the scanner.
        """
        if isinstance(generators, int):
            generators = [generator(generators, f"robot {k}") for k in range(fleet.size)]
        count = len(generators)
        require(count == fleet.size, "generators", count, f"{fleet.size}, one per robot")
        self._scanner = scanner
        self._fleet = fleet
        self._random = [g.spawn(1)[0] for g in generators]
        self._noise = np.broadcast_to(scanner.noise if noise is None else noise, (fleet.size,))
        require(bool((self._noise >= 0).all()), "noise", self._noise.tolist(), "at least 0 m")
        robot = fleet.robot
        x, y, self._heading = robot.lrf_mount
        self._origin = np.array([x, y, robot.lrf_height])
        self.kept = kept or robot.contact_sensors
        """Whether logs have all ranges."""
        self.period = scanner.period
        """Time between scans [s]."""
        self.bearings = scanner.bearings
        """Directions (B,) of the beams in the LRF's frame [rad]."""
        direction = self._heading + self.bearings
        self._rays = np.zeros((len(direction), 3))  # unit vectors along the beams
        self._rays[:, 0] = np.cos(direction)
        self._rays[:, 1] = np.sin(direction)
        obstacles = obstacles or Obstacles()
        obstacles.require_clear(self._origin[:2])
        self._around = obstacles.ranges(self._origin[:2], self._rays[:, :2])  # (B,) [m]
        self._aim: _Aim | None = None
        self._aimed_rays: Array = np.empty((fleet.size, 0, 3))  # (N, W, 3)
        self._aimed_origins: Array = np.empty((fleet.size, 0, 3))  # (N, W, 3)
        self._groups = (np.arange(6) == SCANNED_GROUP).astype(np.uint8)
        self._lrf = robot.model.body("lrf").id

    def restart(self, robots: np.ndarray, generators: Sequence[np.random.Generator]) -> None:
        """Restart the noise of the robots with indices `robots` (R,), with one generator each."""
        for robot, g in zip(robots, generators, strict=True):
            (self._random[robot],) = g.spawn(1)

    def true_ranges(self) -> Array:
        """Ranges (N, B) without measurement errors, NaN for beams without an echo [m]."""
        aim = self._aimed()
        distance, *_ = self._fleet.batch.ray(
            self._aimed_origins, self._aimed_rays, geomgroup=self._groups, bodyexclude=self._lrf
        )
        distance[distance < 0] = np.nan
        nearest = np.fmin(distance, self._around[aim.beams])
        ranges = np.tile(self._around, (self._fleet.size, 1))
        np.put_along_axis(ranges, aim.beams, nearest, axis=1)
        return ranges

    def _aimed(self) -> _Aim:
        centre = self._fleet.plate
        if self._aim is None or not self._aim.holds(centre):
            radius = self._fleet.robot.plate_radius
            self._aim = _Aim.at(centre.copy(), self._origin, self._heading, radius, self.bearings)
            self._aimed_rays = self._rays[self._aim.beams]
            self._aimed_origins = np.broadcast_to(self._origin, self._aimed_rays.shape).copy()
        return self._aim

    def measure(self, true_ranges: Array) -> Array:
        """Measured ranges (N, ..., B) for true ranges (N, ..., B) [m]; each robot has its own
        generator.
        """
        return self._scanner.measure(true_ranges, self._random, self._noise)

    def scan(self, ranges: Array) -> Scan:
        """A Scan from this LRF with ranges (..., B) [m]."""
        return self._scanner.scan(ranges, self._fleet.robot.lrf_mount)
