"""Who drives a robot over a course: constant speeds, a path, or somebody at the keyboard."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from sim.traverse.bodies import States
from trackslip.kinematics import Array
from trackslip.trajectory.waypoints import read_waypoints

_SPACING = 0.02  # of the points of a path [m]
_SEARCH = 1.0  # how far ahead on a path the robot is looked for [m]
_SHARPEST = 4.0  # curvature of an arc towards a path [1/m]


class CoursePilot(Protocol):
    """Gives the belts their speeds."""

    def speeds(self, state: States) -> Array | None:
        """Belt speeds (2,), left and right, of the robot in row 0 of `state` [m/s]; None once there is nothing left."""


@dataclass(frozen=True)
class ConstantPilot:
    """Open loop: the same speeds all the time."""

    left: float
    """Speed of the left belt [m/s]."""
    right: float
    """Speed of the right belt [m/s]."""

    def speeds(self, state: States) -> Array | None:
        """See `CoursePilot`."""
        return np.array([self.left, self.right])


@dataclass
class PathPilot:
    """Pure pursuit of a path by the true position: an arc towards the point `look_ahead` further on (Coulter, 1992)."""

    points: Array  # (P, 2) along the path, evenly spaced [m]
    speed: float
    """Speed of the robot, if it didn't slip [m/s]."""
    half_gauge: float
    """Half the distance between the tracks [m]."""
    look_ahead: float = 0.5
    """Distance of the point that the robot drives to, along the path [m]."""
    _at: int = field(default=0, init=False)  # index of the point that the robot has got to

    @classmethod
    def of(cls, path: Path, speed: float, half_gauge: float) -> PathPilot:
        """Follow the way points in a .csv file; raises ReferenceFileError if they can't be driven."""
        reference = read_waypoints(path)
        dense = reference.pose(np.linspace(0.0, reference.duration, 20_000))[:, :2]
        way = np.append(0.0, np.cumsum(np.hypot(*np.diff(dense, axis=0).T)))
        even = np.linspace(0.0, way[-1], max(2, round(way[-1] / _SPACING) + 1))
        points = np.stack([np.interp(even, way, column) for column in dense.T], axis=-1)
        return cls(points, speed, half_gauge)

    def speeds(self, state: States) -> Array | None:
        """See `CoursePilot`."""
        here, heading = state.position[0, :2], float(state.heading[0])
        ahead = self.points[self._at : self._at + round(_SEARCH / _SPACING)]
        self._at += int(np.argmin(np.hypot(*(ahead - here).T)))
        if self._at >= len(self.points) - 1:
            return None
        goal = self.points[min(self._at + round(self.look_ahead / _SPACING), len(self.points) - 1)]
        x, y = goal - here
        across = y * np.cos(heading) - x * np.sin(heading)
        along = x * np.cos(heading) + y * np.sin(heading)
        distance = max(float(np.hypot(x, y)), self.look_ahead / 2)
        curvature = float(np.clip(2 * across / distance**2, -_SHARPEST, _SHARPEST))
        if along < 0:  # it has passed the goal by: turn on the spot
            return self.speed * np.sign(across) * np.array([-1.0, 1.0])
        outer = 1 + abs(curvature) * self.half_gauge  # the faster belt runs at the set speed
        return np.asarray(self.speed / outer * (1 + curvature * self.half_gauge * np.array([-1.0, 1.0])))
