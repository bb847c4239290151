"""Course crossing as a learning task for N robots, one row each: actions in, observations and
rewards out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.common.settings import options_of
from sim.learning.task import Element, Floats, Task
from sim.robot.named import load_tracked
from sim.terrain import Course, load_course
from sim.traverse.config import MASSES, SAMPLE, CrossingLayout, TraverseConfig, one_by_one
from sim.traverse.courses import DRAWN, FTR_BOXES, MAX_BOXES, RANDOM, draw_course
from sim.traverse.ground import Footprint
from sim.traverse.outcome import Outcome, Outcomes
from sim.traverse.policy import scripted
from sim.traverse.world import Command, Traverse
from trackslip.errors import one_of, require, require_at_most, require_range, require_within
from trackslip.kinematics import Array

_OPTIONS: Final = {
    "course": str | Course,
    "difficulty": float,
    "start_offset": float,
    "start_heading": float,
    "mass": float,
}
_QUARTER: Final = np.pi / 2  # flipper angle for an action of 1 [rad]
_NOT_DRAWN: Final = -1.0  # difficulty that is stored for courses that were not drawn
_SPEED_CORRECTION: Final = 0.3  # largest correction to belt speeds [m/s]
_ANGLE_CORRECTION: Final = 0.8  # largest correction to flipper angles [rad]
_GRAVITY: Final = 9.81  # [m/s^2]


@dataclass(frozen=True)
class CourseRun:
    """The course and conditions for one robot in one episode."""

    course: Course
    difficulty: float  # difficulty of the course; -1 if it was not drawn [-]
    start: tuple[float, float, float]  # start pose (x, y, heading) [m, m, rad]
    seed: int = 0  # seed of the sensor noise
    mass: float = 1.0  # factor on the chassis' mass [-]


class Actions:
    """Conversion of actions to set points for the robots in a world."""

    def __init__(self, config: TraverseConfig, world: Traverse) -> None:
        self._world = world
        self._corrects = config.action == "correction"
        # names of the actions for flippers, and the one that each flipper follows
        names = list(world.tracked.flipper_names)
        followed = names
        if config.flippers == "pairs":
            followed = [
                f"{end} flippers" for end in np.where(world.flippers.front, "front", "rear")
            ]
            names = sorted(set(followed))
        self._member = np.array([names.index(name) for name in followed], int)
        self._speed_scale = _SPEED_CORRECTION if self._corrects else world.top_speed
        self._angle_scale = _ANGLE_CORRECTION if self._corrects else _QUARTER
        kind = "correction" if self._corrects else "set point"
        elements = []
        for side in ("left", "right"):
            elements.append(Element(f"{side} belt speed, {kind}", "m/s", self._speed_scale))
        for name in names:
            elements.append(Element(f"{name}, {kind}", "rad", self._angle_scale))
        self.elements = tuple(elements)
        """Names, units and scales of an action's elements (A)."""

    def command(self, action: Array) -> Command:
        """The set points for actions (N, A) in [-1, 1]."""
        speed = self._speed_scale * action[:, :2]
        angle = self._angle_scale * action[:, 2:][:, self._member]
        if self._corrects:
            by_script = scripted(self._world)
            return Command(by_script.speed + speed, by_script.flippers + angle)
        return Command(speed, angle)


class Crossing(Task):
    """The task in which robots cross courses."""

    STATE = (
        "world",
        "difficulty",
        "_difficulty",
        "_seed",
        "_length",
        "_penetration",
        "_work",
        *Task.STATE,
    )

    def __init__(self, config: TraverseConfig, size: int, threads: int = 0) -> None:
        """Prepare `size` robots on `threads` worker threads (0: one per processor); `begin` starts
        their episodes.
        """
        robot = load_tracked(config.robot)
        self._hull = robot.hull
        self._footprint = Footprint.of(robot)
        self._drawn = [course for course in config.courses if course in DRAWN]
        self._listed: dict[str | Course, Course] = {}  # by name, or by the course itself
        for course in config.courses:
            if course not in DRAWN:
                loaded = load_course(course) if isinstance(course, str) else course
                self._listed[course] = self._footprint.fit(loaded)
        courses = list(self._listed.values())
        if self._drawn:  # one of them, for the friction and the width
            easiest = draw_course(RANDOM, 0.0, np.random.default_rng(0), self._hull)
            courses.append(self._footprint.fit(easiest))
        boxes = [MAX_BOXES if name == RANDOM else FTR_BOXES for name in self._drawn]
        widest = min(course.width for course in courses) / 2
        unit = "m, half the width of a course"
        require_at_most("start_offset", config.start_offset, widest, unit)
        self.world = Traverse(
            robot,
            courses,
            size,
            boxes=max(boxes, default=0),
            limits=config.limits,
            period=config.period,
            sample=SAMPLE,
            threads=threads,
        )
        tracked = self.world.tracked
        self._weight = _GRAVITY * tracked.model.body_subtreemass[tracked.body]  # of a robot [N]
        self.layout = CrossingLayout(self.world, config.noise)
        self.actions = Actions(config, self.world)
        super().__init__(config, size, config.period, self.layout.elements, self.actions.elements)
        self.difficulty = config.difficulty
        """Range for the difficulty of later courses [-]."""
        self._difficulty: Array = np.full(size, _NOT_DRAWN)
        self._seed: NDArray[np.int_] = np.zeros(size, int)  # seeds (N,) of the sensor noise
        self._length: Array = np.ones(size)  # distances (N,) from start to goal [m]
        self._penetration: Array = np.zeros(size)  # largest penetrations (N,) in the episode [m]
        self._work: Array = np.zeros(size)  # work (N,) of the belts in the episode [J]

    @property
    def outcome(self) -> Outcomes:
        """Outcomes (N,) of the present episodes."""
        return self.world.outcome

    def set_difficulty(self, low: float, high: float) -> None:
        """Set the range for the difficulty of later courses; raises InvalidValueError unless it is
        within 0 to 1.
        """
        require_range("difficulty", (low, high), 0.0, 1.0)
        self.difficulty = low, high

    def draw(self, generator: np.random.Generator, options: Mapping[str, Any]) -> CourseRun:
        """Draw a robot's episode; `options` replace drawn values, without an effect on the other
        draws.

        The options are `course`, a name from the environment's configuration or a course of boxes;
        `difficulty` of a drawn course [-]; `start_offset`, to the left [m]; `start_heading` [rad];
        and `mass`, a factor on the chassis' mass [-]. Raises InvalidValueError for unknown options
        and values out of range.
        """
        options = options_of("options", options, _OPTIONS)
        seed = int(generator.integers(2**63))
        chosen = self._drawn_values(generator, seed) | options
        difficulty = chosen["difficulty"]
        offset = chosen["start_offset"]
        heading = chosen["start_heading"]
        mass = chosen["mass"]
        require_within("difficulty", difficulty, 0.0, 1.0)
        require_within("start_heading", heading, -np.pi, np.pi, "rad")
        require_within("mass", mass, *MASSES)

        course = self._course(chosen["course"], difficulty, np.random.default_rng(seed))
        if chosen["course"] not in self._drawn:
            difficulty = _NOT_DRAWN
            names = [name for name in (*self._listed, *self._drawn) if isinstance(name, str)]
            valid = isinstance(course, Course) or course in names
            require(valid, "course", course, f"a course, or {one_of(names, course)}")
        course = self._listed.get(course) or self._footprint.fit(course)

        _, y, _, ahead = course.start
        require_within("start_offset", offset, -course.width / 2, course.width / 2, "m")
        heading = ahead + heading
        x = self._footprint.start(course, heading)
        return CourseRun(
            course=course,
            difficulty=float(difficulty),
            start=(x, y + offset, heading),
            seed=seed,
            mass=float(mass),
        )

    def _drawn_values(self, generator: np.random.Generator, seed: int) -> dict[str, Any]:
        """Draw the values of all options; `seed` is that of the course."""
        config = self.config
        low, high = self.difficulty
        course = config.courses[generator.integers(len(config.courses))]
        difficulty = low + (high - low) * float(generator.random())
        drawn = {
            "course": course,
            "difficulty": difficulty,
            "start_offset": generator.uniform(-1.0, 1.0) * config.start_offset,
            "start_heading": generator.uniform(-1.0, 1.0) * config.start_heading,
        }
        # the mass is drawn after the seed's course, also if another one is given
        own = np.random.default_rng(seed)
        self._course(course, difficulty, own)
        drawn["mass"] = own.uniform(*config.mass)
        return drawn

    def _course(
        self, course: str | Course, difficulty: float, generator: np.random.Generator
    ) -> Any:
        """The course itself or, for a name of courses that are drawn anew, a course drawn by
        `generator`.
        """
        if course not in self._drawn:
            return course
        config = self.config
        return draw_course(
            str(course), difficulty, generator, self._hull, config.obstacles, config.kinds
        )

    def begin(self, rows: Sequence[int], episodes: Sequence[CourseRun]) -> None:
        """Begin an episode with each of the robots `rows` (R,)."""
        where = np.asarray(rows, int)
        if not where.size:
            return
        courses = [episode.course for episode in episodes]
        starts = [episode.start for episode in episodes]
        masses = [episode.mass for episode in episodes]
        self.world.begin(where, courses, starts, mass=masses)
        self._difficulty[where] = [episode.difficulty for episode in episodes]
        self._seed[where] = [episode.seed for episode in episodes]
        self._length[where] = self.world.distance_to_goal[where]
        self._clear(where, self._penetration, self._work)

    def step(self, actions: ArrayLike) -> None:
        """Simulate one control period, see Task; robots whose episodes have ended stand still."""
        action, change = self._clipped(actions)
        running = self.outcome == Outcome.DRIVING
        before = self.world.distance_to_goal
        self.world.step(self.actions.command(action))
        work = np.where(running, one_by_one(self.world.work), 0.0)
        self._work += work
        depth = np.where(running, self.world.contact.depth.max(axis=1), 0.0)
        self._penetration = np.maximum(self._penetration, depth)
        gain = np.where(running, before - self.world.distance_to_goal, 0.0)
        ended = np.where(running, self.outcome, Outcome.DRIVING)
        duration = np.where(running, self.period, 0.0)
        change = np.where(running[:, None], change, 0.0)
        terms = self.config.reward.terms(gain, work / self._weight, duration, change, ended)
        self._earn(terms, running)
        self.truncated = self.outcome == Outcome.TIME
        self.terminated = (self.outcome != Outcome.DRIVING) & ~self.truncated

    def _observed(self) -> Floats:
        return self.layout.observation(self.world, self._seed.tolist())

    def _quantities(self) -> dict[str, NDArray[Any]]:
        world = self.world
        contact = world.contact
        defined = np.isfinite(contact.slip)
        return {
            "time": world.time,  # [s]
            "outcome": np.array([Outcome(outcome).label for outcome in self.outcome], object),
            "difficulty": self._difficulty,
            # share of the distance from start to goal [-]
            "progress": 1 - world.distance_to_goal / self._length,
            "true_position": world.state.position,  # (N, 3) [m]
            "true_velocity": world.state.velocity,  # (N, 3) [m/s]
            "true_slip": np.where(defined, contact.slip, 0.0),  # (N, T) [-]
            # (N, T), whether the track touched the ground and its belt ran
            "slip_defined": defined,
            "load": contact.load,  # (N, T) [N]
            "traction": contact.traction,  # (N, T) [N]
            "penetration": self._penetration,  # (N,), largest so far [m]
            "work": self._work,  # (N,), of the belts so far [J]
        }
