"""The ground that a robot covers: where it starts on a course, where it has crossed it, and courses that it fits on."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from sim.robot.tracked import TrackedRobot
from sim.robot.tracked_model import FlipperGeometry, build_tracked
from sim.terrain import Course
from trackslip.errors import require

_BEFORE = 0.05  # between a robot and the first piece; heights are looked up in cells of 2 cm [m]
_BESIDE = 1.5  # width of a course that a robot fits on, over the robot's [-]


@dataclass(frozen=True)
class Footprint:
    """Rectangle around the tracks of a robot, its flippers level, in its frame."""

    ahead: float  # front end [m]
    behind: float  # distance of the rear end [m]
    aside: float  # half of the width [m]

    @classmethod
    def of(cls, robot: TrackedRobot, flippers: FlipperGeometry | None = None) -> Footprint:
        """The footprint of a robot; its `flippers` are compiled unless they are given."""
        x, _, radius = np.array(robot.hull).T
        ahead, behind, aside = [(x + radius).max()], [(radius - x).max()], [robot.half_gauge + robot.width / 2]
        if robot.flippers:
            flippers = flippers or build_tracked(robot).flippers
            reach = flippers.length + flippers.radius
            ahead += list(flippers.hinge[:, 0] + np.where(flippers.front, reach, 0.0))
            behind += list(np.where(flippers.front, 0.0, reach) - flippers.hinge[:, 0])
            aside += [abs(y) + each.width / 2 for y, each in zip(flippers.hinge[:, 1], robot.flippers, strict=True)]
        return cls(float(max(ahead)), float(max(behind)), float(max(aside)))

    @property
    def turning(self) -> float:
        """Length of a platform on which the robot fits with any heading [m]."""
        return math.hypot(self.ahead, self.aside) + math.hypot(self.behind, self.aside) + _BEFORE

    def start(self, course: Course, heading: float = 0.0) -> float:
        """Place along a course at which a robot starts: `Course.start`, or before it for all of a long robot to fit.

        Raises InvalidValueError for a course whose start platform is too small for the robot.
        """
        ahead, behind = (self.ahead, self.behind) if math.cos(heading) >= 0 else (self.behind, self.ahead)
        cos, corner = abs(math.cos(heading)), self.aside * abs(math.sin(heading))
        front, rear = ahead * cos + corner + _BEFORE, behind * cos + corner
        for name, least in (("start_length", front + rear), ("width", 2 * self.aside)):
            allowed = f"at least {least:.3g} m for this robot to stand before the first piece"
            require(getattr(course, name) >= least, name, getattr(course, name), allowed)
        return max(min(course.start[0], -front), rear - course.start_length)

    def goal(self, course: Course) -> float:
        """Place along a course at which a robot has crossed it: `Course.goal`, or behind it for all of a long one."""
        return max(course.goal, course.placed[-2].x + self.behind)

    def fit(self, course: Course) -> Course:
        """The course itself, or as much longer before and behind the pieces and wider as the robot needs."""
        start, goal = max(course.start_length, self.turning), max(course.goal_length, self.ahead + self.behind)
        width = max(course.width, 2 * _BESIDE * self.aside)
        if (start, goal, width) == (course.start_length, course.goal_length, course.width):
            return course
        return replace(course, start_length=start, goal_length=goal, width=width)
