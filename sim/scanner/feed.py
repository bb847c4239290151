"""Scans of a fleet: from the rays, noise and limits of the laser range finder to a Scan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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

_SLACK = 0.2  # margin around the plate, so that beams need not be selected again for every scan [m]


@dataclass(frozen=True)
class _Aim:
    """The beams that can hit plates near `centre`, whatever their headings; the same number W for every robot."""

    centre: Array  # (N, 3) centres of the plates when the beams were selected [m]
    beams: np.ndarray  # (N, W) indices into all B beams

    @classmethod
    def at(cls, centre: Array, origin: Array, heading: float, radius: float, bearings: Array) -> _Aim:
        """Select the beams to cast at plates around `centre` (N, 3) [m].

        The beams start at `origin` (3,) [m] with equally spaced, ascending `bearings` (B,) relative to the world
        direction `heading` [rad]. No point of a plate is farther than `radius` from its centre [m].
        """
        radius += _SLACK
        x, y = (centre - origin)[:, :2].T
        distance = np.hypot(x, y)
        bearing = wrap_angle(np.arctan2(y, x) - heading)
        spread = np.where(distance > radius, np.arcsin(np.minimum(radius / np.maximum(distance, radius), 1.0)), np.pi)
        last = len(bearings) - 1
        step = (bearings[-1] - bearings[0]) / last
        low, high = ((edge - bearings[0]) / step for edge in (bearing - spread, bearing + spread))
        around = np.abs(bearing) + spread > np.pi  # behind the scanner, where the bearing wraps
        low, high = np.where(around, 0, np.clip(low, 0, last)), np.where(around, last, np.clip(high, 0, last))
        first = np.floor(low).astype(int)
        count = min(int((np.ceil(high) - first).max()), last) + 1
        return cls(centre, np.minimum(first, last + 1 - count)[:, None] + np.arange(count))

    def holds(self, centre: Array) -> bool:
        """True if the selection is still valid for plates around `centre` (N, 3)."""
        return bool(np.abs(centre - self.centre).max() <= _SLACK / 2)


class ScannerFeed(Restorable):
    """The scanners of a fleet: each robot is observed by its own laser range finder (LRF) in its own world."""

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
            scanner: the scanner's properties.
            fleet: N robots.
            generators: one per robot, so that its noise doesn't depend on what else is simulated; or a seed for them.
            obstacles: obstacles in the field, the same for all robots; by default there are none.
            kept: whether logs have all ranges, not only those of the plate; always true for robots with contact
                sensors.
            noise: standard deviation of ranges for each robot's scanner (N,); by default that of `scanner` [m].

        Raises:
            InvalidValueError: for a wrong number of generators, negative noise, and an obstacle on the scanner.
        """
        if isinstance(generators, int):
            generators = [generator(generators, f"robot {k}") for k in range(fleet.size)]
        require(len(generators) == fleet.size, "generators", len(generators), f"{fleet.size}, one per robot")
        self._scanner, self._fleet = scanner, fleet
        self._random = [g.spawn(1)[0] for g in generators]
        self._noise = np.broadcast_to(scanner.noise if noise is None else noise, (fleet.size,))
        require(bool((self._noise >= 0).all()), "noise", self._noise.tolist(), "at least 0 m")
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
        self._aim: _Aim | None = None
        self._aimed_rays: Array = np.empty((fleet.size, 0, 3))  # (N, W, 3)
        self._aimed_origins: Array = np.empty((fleet.size, 0, 3))  # (N, W, 3)
        self._groups = (np.arange(6) == SCANNED_GROUP).astype(np.uint8)
        self._lrf = robot.model.body("lrf").id

    def restart(self, robots: np.ndarray, generators: Sequence[np.random.Generator]) -> None:
        """Restart the noise of some robots (R,), with one generator each."""
        for robot, g in zip(robots, generators, strict=True):
            (self._random[robot],) = g.spawn(1)

    def true_ranges(self) -> Array:
        """Ranges (N, B) without measurement errors, NaN for beams that hit nothing [m]."""
        aim = self._aimed()
        distance, *_ = self._fleet.batch.ray(
            self._aimed_origins, self._aimed_rays, geomgroup=self._groups, bodyexclude=self._lrf
        )
        distance[distance < 0] = np.nan
        ranges = np.tile(self._around, (self._fleet.size, 1))
        np.put_along_axis(ranges, aim.beams, np.fmin(distance, self._around[aim.beams]), axis=1)
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
        """Measured ranges (N, ..., B) for true ranges (N, ..., B) [m]; each robot's scanner has its own generator."""
        return self._scanner.measure(true_ranges, self._random, self._noise)

    def scan(self, ranges: Array) -> Scan:
        """A Scan by this LRF with ranges (..., B) [m]."""
        return self._scanner.scan(ranges, self._fleet.robot.lrf_mount)
