"""From the options of `trackslip drive` to a robot at the start of a course."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from experiments.common.plain_json import plain
from experiments.drive.config import Config
from experiments.drive.course import PERIOD, SAMPLE, PathPilot, Pilot
from sim.robot.named import load_tracked
from sim.robot.tracked import TrackedRobot
from sim.robot.tracked_model import TrackedModel, build_tracked, clear_angles
from sim.seeds import generator
from sim.terrain import Course, load_course
from sim.traverse.ftr_courses import FTR_COURSES, draw_ftr_course
from sim.traverse.outcome import Limits
from sim.traverse.reflex import Reflex
from sim.traverse.states import Servos
from sim.traverse.world import Traverse
from trackslip.errors import InvalidValueError
from trackslip.kinematics import Array

TOP_SPEED = 0.6
"""Largest speed of the belts by hand [m/s]."""


@dataclass(frozen=True)
class CourseWorld:
    """A robot at the start of a course."""

    robot: TrackedRobot
    course: Course
    traverse: Traverse
    config: Config

    @classmethod
    def of(cls, config: Config) -> CourseWorld:
        """Build the world; raises TrackslipError for a robot or a course that can't be built."""
        robot = load_tracked(config.robot)
        if config.course in FTR_COURSES:
            seed = config.seed or 0
            drawn = draw_ftr_course(config.course, config.difficulty, generator(seed, config.course), robot.hull)
            course = replace(drawn, seed=seed)
        else:
            course = load_course(config.course, config.seed, FTR_COURSES)
        if config.friction is not None:
            course = replace(course, friction=config.friction)
        fastest = abs(config.speed) + abs(config.turn) * robot.half_gauge
        world = Traverse(
            robot,
            [course],
            preset=config.preset,
            servos=Servos(top_speed=max(TOP_SPEED, fastest)),
            limits=Limits(time=config.duration),
            period=PERIOD,
            sample=SAMPLE,
            threads=1,
        )
        made = cls(robot, course, world, config)
        world.begin([0], flippers=clear_angles(world.tracked, made.set_angles))
        return made

    @property
    def set_angles(self) -> Array:
        """Angles (F,) asked of the flippers, tips up; 0 by reflex [rad]."""
        given, count = self.config.flipper_angles(), len(self.robot.flippers)
        if given is None:
            return np.zeros(count)
        if len(given) == 1:
            return np.full(count, given[0])
        if len(given) == 2:
            return np.where(self.traverse.tracked.flipper_front, *given)
        if len(given) != count:
            allowed = f"one angle, two (front, rear) or {count}, one for each flipper of {self.robot.name}"
            raise InvalidValueError("flippers", self.config.flippers, allowed)
        return np.array(given)

    def flippers(self) -> Callable[[Traverse], Array]:
        """Source of the flippers' angles."""
        if self.config.flipper_angles() is None:
            return lambda world: world.reflex(Reflex())[0]
        angles = self.set_angles
        return lambda world: angles

    def pilot(self) -> Pilot:
        """The driver without a keyboard: along the path, or at constant speeds."""
        config = self.config
        if config.path is not None:
            return PathPilot.of(config.path, config.speed, self.robot.half_gauge)
        speeds = config.speed + config.turn * self.robot.half_gauge * np.array([-1.0, 1.0])
        return lambda state: speeds

    def with_looks(self) -> TrackedModel:
        """The same model with everything that is only for looks."""
        return build_tracked(self.robot, self.course, preset=self.config.preset, looks=True)

    @property
    def about(self) -> dict[str, Any]:
        """The metadata of a run: robot and course, as far as the options leave them open."""
        robot, course, tracked = self.robot, self.course, self.traverse.tracked
        return {
            "geometry": {"half_gauge": robot.half_gauge, "sprocket_radius": max(r for _, _, r in robot.hull)},
            "robot": {**plain(robot), "model": robot.model.name, "packages": [each.name for each in robot.packages]},
            "course": {"friction": course.friction, "seed": course.seed, "goal": course.goal, "width": course.width},
            "seed": course.seed,
            "mass": float(tracked.model.body_subtreemass[tracked.body]),
        }
