"""Options of the environment trackslip/Traverse-v0, the keyword arguments of `gymnasium.make`."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from sim.drive.drive import MAX_SPEED, Drive, Servos
from sim.robot.named import RobotSource
from sim.robot.tracked import TrackedRobot
from sim.task import MAX_WEIGHT, OwnTerms
from sim.terrain import Course, load_course
from sim.traverse.courses import FTR_COURSES, OBSTACLES, require_kinds
from sim.traverse.observation import SensorNoise
from sim.traverse.outcome import Limits
from sim.traverse.policy import Scripted
from trackslip.errors import Checked, checked, require, require_non_negative, require_positive, require_range

PERIOD = 0.1
"""Default control period [s]."""
SAMPLE = 0.02
"""Time between changes of the belts' speeds [s]."""
MASSES = 0.2, 5.0
"""Limits of the factor on a chassis' mass [-]."""
RANDOM = "random"
"""Name of randomly drawn courses; see `courses.draw_course`."""
DRAWN = (RANDOM, *FTR_COURSES)
"""Names of courses that each episode draws anew."""
_ACTIONS = ("direct", "correction")
_FLIPPERS = ("each", "pairs")


@dataclass(frozen=True)
class CrossingReward(Checked):
    """The reward of a step: a sum of terms, each of which is given by name in `info`.

    progress            weight_progress times the way that the robot came closer to the goal [m]
    energy              -weight_energy times the work of the belts against the ground [J]
    time                -weight_time times the control period
    change              -weight_change times the mean square of the change of the actions
    end                 weight_reached for a crossed course; -weight_failed for tipping over, falling, exploding or
                        being stuck; nothing where time runs out, which truncates the episode

    The cost of failing is less than that of standing still from then on, discounted by up to 0.97 per step: who tries
    and fails earns more than who waits.
    """

    weight_progress: float = checked(2.0, require_non_negative, MAX_WEIGHT)
    """CrossingReward per way [1/m]."""
    weight_energy: float = checked(0.001, require_non_negative, MAX_WEIGHT)
    """Cost of work [1/J]."""
    weight_time: float = checked(0.5, require_non_negative, MAX_WEIGHT)
    """Cost of time [1/s]."""
    weight_change: float = checked(0.005, require_non_negative, MAX_WEIGHT)
    """Cost of changes of the actions [-]."""
    weight_reached: float = checked(5.0, require_non_negative, MAX_WEIGHT)
    """CrossingReward, once, for crossing the course [-]."""
    weight_failed: float = checked(1.0, require_non_negative, MAX_WEIGHT)
    """Penalty, once, for failing [-]."""


@dataclass(frozen=True)
class TraverseConfig(OwnTerms):
    """The task of crossing a course."""

    robot: RobotSource = "rescue"
    """Name of a robot, its .toml file, or the robot."""
    course: str | Course | tuple[str | Course, ...] = RANDOM
    """A course, the name of one, "random", one of `FTR_COURSES`, or a .toml file; if there are several, each episode
    draws one."""
    difficulty: tuple[float, float] = checked((0.0, 1.0), require_range, 0.0, 1.0)
    """Range from which the difficulty of courses that are drawn is drawn, within 0 to 1 [-]."""
    obstacles: int = 2
    """Number of obstacles on a random course, 1 or 2."""
    kinds: tuple[str, ...] = OBSTACLES
    """Kinds of obstacles that random courses have."""
    action: str = "direct"
    """Meaning of the actions in [-1, 1]: "direct", set points in units of the top speed and of pi / 2; "correction",
    what is added to the set points of `scripted`."""
    flippers: str = "each"
    """One action for "each" flipper, or for each of the front and rear "pairs"."""
    speed_authority: float = checked(0.3, require_positive, MAX_SPEED, "m/s")
    """Largest correction of a belt's speed [m/s]."""
    flipper_authority: float = checked(0.8, require_positive, math.pi, "rad")
    """Largest correction of a flipper's set point [rad]."""
    scripted: Scripted = field(default_factory=Scripted)
    """The scripted controller."""
    start_offset: float = checked(0.1, require_non_negative)
    """Largest offset of the start to either side, drawn evenly [m]."""
    start_heading: float = checked(0.1, require_non_negative, math.pi, "rad")
    """Largest heading at the start, in either direction, drawn evenly [rad]."""
    mass: tuple[float, float] = checked((1.0, 1.0), require_range, *MASSES)
    """Range from which a factor on the mass and the inertia of the chassis is drawn, as of a payload [-]."""
    period: float = PERIOD
    """Control period: time between actions, a multiple of 0.02 s [s]."""
    preset: str = "fast"
    """Contact preset of the tracks."""
    reward: CrossingReward = field(default_factory=CrossingReward)
    """The reward of a step."""
    noise: SensorNoise = field(default_factory=SensorNoise)
    """Noise of the observations."""
    limits: Limits = field(default_factory=Limits)
    """Limits that end an episode."""
    servos: Servos | None = None
    """Servos of belts and flippers; by default with the lag and the top speed of the motors in the robot's file."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, choices in (("action", _ACTIONS), ("flippers", _FLIPPERS)):
            require(getattr(self, name) in choices, name, getattr(self, name), f"one of {', '.join(choices)}")
        valid = self.courses and all(isinstance(course, str | Course) for course in self.courses)
        require(valid, "course", self.course, "a course, a name, or a tuple of those")
        for course in self.courses:
            if isinstance(course, str) and course not in DRAWN:
                load_course(course, drawn=DRAWN)
        require_kinds(self.kinds)
        require(self.obstacles in (1, 2), "obstacles", self.obstacles, "1 or 2")
        allowed = f"a multiple of {SAMPLE} s, up to 1 s"
        require(0 < self.period <= 1, "period", self.period, allowed)
        require(abs(self.period / SAMPLE - round(self.period / SAMPLE)) < 1e-9, "period", self.period, allowed)

    @property
    def courses(self) -> tuple[str | Course, ...]:
        """Courses from which episodes draw."""
        return (self.course,) if isinstance(self.course, str | Course) else tuple(self.course)

    def servos_of(self, robot: TrackedRobot) -> Servos:
        """The servos of belts and flippers."""
        if self.servos is None and robot.drive != Drive():
            return Servos(robot.drive.lag, robot.drive.top_speed)
        return self.servos or Servos()
