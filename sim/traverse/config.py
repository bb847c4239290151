"""Options and observations of the environment trackslip/Traverse-v0; with F flippers, float32 (10 +
2 F + 45,).

Observations consist of attitude, rates, position on the course, belts, flippers (tips up) and a map
of ground heights above the lowest point of the level robot. The map is aligned with the robot's
heading, with columns at the distances `AHEAD` in front of the robot and rows at `ASIDE` to its
left; it is flattened row by row.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Final

import numpy as np

from sim.learning.task import MAX_WEIGHT, Element, Floats, OwnTerms
from sim.robot.named import RobotSource
from sim.terrain import Course, load_course
from sim.traverse.courses import DRAWN, OBSTACLES, RANDOM
from sim.traverse.outcome import Limits, Outcome, Outcomes
from sim.traverse.world import Traverse
from trackslip import se2
from trackslip.arguments import checks_arguments
from trackslip.errors import (
    Checked,
    checked,
    require,
    require_non_negative,
    require_one_of,
    require_range,
)
from trackslip.kinematics import Array

AHEAD: Final = np.linspace(-0.5, 0.9, 15)
"""Distances of the map's columns ahead of the robot [m]."""
ASIDE: Final = np.array([-0.22, 0.0, 0.22])
"""Distances of the map's rows to the left of the robot [m]."""
SAMPLE: Final = 0.02
"""Time between changes in the belt speeds [s]."""
MASSES: Final = (0.2, 5.0)
"""Smallest and largest factor on the chassis' mass [-]."""
_ACTIONS: Final = ("direct", "correction")
_FLIPPERS: Final = ("each", "pairs")
_QUARTER: Final = np.pi / 2  # flipper angle at which an element is 1 [rad]
_MAX_PERIOD: Final = 1.0  # [s]
_ROUNDING: Final = 1e-9  # tolerance on shares of a sample


@dataclass(frozen=True)
class SensorNoise(Checked):
    """Standard deviations of Gaussian noise in the observations, independent between steps."""

    attitude: float = checked(0.0, require_non_negative, 10.0)
    """Noise in each component of the vertical in the robot's frame [-]; its errors are small angles
    [rad].
    """
    rate: float = checked(0.0, require_non_negative, 10.0)
    """Noise in the roll, pitch and yaw rates [rad/s]."""
    position: float = checked(0.0, require_non_negative, 10.0)
    """Noise in the distance from the course's centre line, from odometry [m]."""
    heading: float = checked(0.0, require_non_negative, 10.0)
    """Noise in the heading, from odometry [rad]."""
    speed: float = checked(0.0, require_non_negative, 10.0)
    """Noise in the belt speeds [m/s]."""
    flipper: float = checked(0.0, require_non_negative, 10.0)
    """Noise in the flipper angles; their set points have no noise [rad]."""
    height: float = checked(0.0, require_non_negative, 10.0)
    """Noise in each height in the map [m]."""


class CrossingLayout:
    """The n elements of an observation."""

    def __init__(self, world: Traverse, noise: SensorNoise) -> None:
        """Determine the elements for the robots in `world`, whose sensors have this `noise`."""
        observed = _observed(world, noise)
        self.elements = tuple(element for element, _ in observed)
        """Names, units, scales and bounds of the elements."""
        self._noise = np.array([deviation for _, deviation in observed])
        self._scale = np.array([element.scale for element in self.elements])
        self._bound = np.array([element.bound for element in self.elements], np.float32)
        self._lowest = world.tracked.robot.lowest
        across, along = np.meshgrid(ASIDE, AHEAD, indexing="ij")
        self._around = np.stack([along.ravel(), across.ravel()], axis=-1)

    def observation(self, world: Traverse, seeds: Sequence[int]) -> Floats:
        """Observations (N, n) of all robots; the noise depends on `seeds` (N,) and on the time
        since each run began.
        """
        state = world.state
        heading = state.heading
        position = state.position
        around = position[:, None, :2] + se2.rotate(heading[:, None], self._around)
        heights = world.elevation(around) - position[:, 2:] - self._lowest
        parts = (
            state.rotation[:, 2],
            state.rate,
            position[:, 1:2],
            heading[:, None],
            world.servo.speed,
            world.tracked.flipper_angles(state.qpos),
            world.flipper_servo.angle,
            heights,
        )
        observed = np.concatenate(parts, axis=1)
        if self._noise.any():
            observed += self._drawn(world, seeds)
        scaled = (observed / self._scale).astype(np.float32)
        return np.clip(scaled, -self._bound, self._bound)

    def _drawn(self, world: Traverse, seeds: Sequence[int]) -> Array:
        """Noise (N, n), drawn anew in each step."""
        steps = np.rint(world.time / world.period).astype(int)
        generators = [np.random.default_rng(key) for key in zip(seeds, steps, strict=True)]
        count = len(self._noise)
        return self._noise * [generator.standard_normal(count) for generator in generators]


def _observed(world: Traverse, noise: SensorNoise) -> list[tuple[Element, float]]:
    """The elements of an observation in their order, each with the deviation of its noise."""
    flippers = world.tracked.flipper_names
    observed = []
    for axis in ("forward", "left", "up"):
        observed.append((Element(f"vertical, {axis}", "-", 1.0), noise.attitude))
    for name in ("roll", "pitch", "yaw"):
        observed.append((Element(f"{name} rate", "rad/s", 2.0, 2.0), noise.rate))
    aside = Element("distance from the middle, to the left", "m", 1.0, 2.0)
    observed.append((aside, noise.position))
    observed.append((Element("heading on the course", "rad", np.pi), noise.heading))
    for side in ("left", "right"):
        observed.append((Element(f"{side} belt speed", "m/s", world.top_speed), noise.speed))
    for name in flippers:
        observed.append((Element(f"{name} angle", "rad", _QUARTER, 2.0), noise.flipper))
    for name in flippers:
        observed.append((Element(f"{name} set point", "rad", _QUARTER, 2.0), 0.0))
    for y in ASIDE:
        for x in AHEAD:
            place = f"({round(x, 2) + 0.0:g}, {y:g})"  # never -0
            observed.append((Element(f"height at {place} m", "m", 0.3, 3.0), noise.height))
    return observed


@dataclass(frozen=True)
class CrossingReward(Checked):
    """Reward for a step: a sum of terms, which `info` lists by name.

        progress    weight_progress times the distance gained towards the goal [m]
        energy      -weight_energy times the belts' work on the ground over the robot's weight [m]
        time        -weight_time times the control period [s]
        change      -weight_change times the mean square of the change in the action
        end         weight_reached if the robot has crossed the course; -weight_failed if it tips
                    over, falls, explodes or is stuck; 0 if time runs out, which truncates the
                    episode

    A failure costs less than standing still for the rest of the episode, even if rewards are
    discounted by a factor of 0.97 per step: a robot that tries and fails earns more than a robot
    that waits.
    """

    TERMS: ClassVar = ("progress", "energy", "time", "change", "end")

    weight_progress: float = checked(2.0, require_non_negative, MAX_WEIGHT)
    """Reward for the distance gained [1/m]."""
    weight_energy: float = checked(0.3, require_non_negative, MAX_WEIGHT)
    """Cost of the work over the robot's weight [1/m]."""
    weight_time: float = checked(0.5, require_non_negative, MAX_WEIGHT)
    """Cost of the time [1/s]."""
    weight_change: float = checked(0.005, require_non_negative, MAX_WEIGHT)
    """Cost of changes in the action [-]."""
    weight_reached: float = checked(5.0, require_non_negative, MAX_WEIGHT)
    """One-time reward for crossing the course [-]."""
    weight_failed: float = checked(1.0, require_non_negative, MAX_WEIGHT)
    """One-time penalty for failing [-]."""

    def terms(
        self, gain: Array, work: Array, duration: Array, change: Array, outcome: Outcomes
    ) -> tuple[Array, ...]:
        """Terms (N,) of the reward, in the order of `TERMS`.

        The terms depend on the distance gained (N,) [m], the belts' work over the robot's weight
        (N,) [m], the time passed (N,) [s], the changes in the actions (N, A) and the outcomes of
        this step (N,).
        """
        has_reached = outcome == Outcome.REACHED
        goes_on = (outcome == Outcome.DRIVING) | (outcome == Outcome.TIME)
        has_failed = ~has_reached & ~goes_on
        square = one_by_one(change**2)
        return (
            self.weight_progress * gain,
            -self.weight_energy * work,
            -self.weight_time * duration,
            -self.weight_change * square / change.shape[1],
            self.weight_reached * has_reached - self.weight_failed * has_failed,
        )


def one_by_one(values: Array) -> Array:
    """Sums (N,) of values (N, n) over n, bitwise identical for any N."""
    return np.add.accumulate(values, axis=1)[:, -1]


@checks_arguments
@dataclass(frozen=True)
class TraverseConfig(OwnTerms):
    """A task of crossing courses."""

    robot: RobotSource = "rescue"
    """Name of a robot, its .toml file, or the robot itself."""
    course: str | Course | tuple[str | Course, ...] = RANDOM
    """Course or courses to draw from in each episode: a course or its name, "random", a name in
    `FTR_COURSES`, or a .toml file.
    """
    difficulty: tuple[float, float] = checked((0.0, 1.0), require_range, 0.0, 1.0)
    """Range, within 0 to 1, for the difficulty of courses that are drawn anew in each episode
    [-].
    """
    obstacles: int = 2
    """Number of obstacles on a random course, 1 or 2."""
    kinds: tuple[str, ...] = OBSTACLES
    """Kinds of obstacles from which random courses draw."""
    action: str = "direct"
    """Meaning of the actions in [-1, 1]: "direct" for set points in units of the top speed and of
    pi / 2, "correction" for corrections to the scripted controller's set points, in units of 0.3
    m/s and 0.8 rad.
    """
    flippers: str = "each"
    """Actions for the flippers: one per flipper ("each"), or one for the front and one for the rear
    ones ("pairs").
    """
    start_offset: float = checked(0.1, require_non_negative)
    """Largest lateral offset of the start, drawn uniformly to either side [m]."""
    start_heading: float = checked(0.1, require_non_negative, math.pi, "rad")
    """Largest heading at the start, drawn uniformly in either direction [rad]."""
    mass: tuple[float, float] = checked((1.0, 1.0), require_range, *MASSES)
    """Range of a random factor on the mass and inertia of the chassis, which may represent a
    payload [-].
    """
    period: float = 0.1
    """Control period, the time between actions; a multiple of 0.02 s [s]."""
    reward: CrossingReward = field(default_factory=CrossingReward)
    """Reward for a step."""
    noise: SensorNoise = field(default_factory=SensorNoise)
    """Noise in the observations."""
    limits: Limits = field(default_factory=Limits)
    """Limits that end an episode."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of("action", self.action, _ACTIONS)
        require_one_of("flippers", self.flippers, _FLIPPERS)
        valid = self.courses and all(isinstance(course, str | Course) for course in self.courses)
        require(valid, "course", self.course, "a course, a name, or a tuple of those")
        for course in self.courses:
            if isinstance(course, str) and course not in DRAWN:
                load_course(course, drawn=DRAWN)
        require(len(self.kinds) > 0, "kinds", self.kinds, f"some of {', '.join(OBSTACLES)}")
        for kind in self.kinds:
            require(kind in OBSTACLES, "kinds", kind, f"some of {', '.join(OBSTACLES)}")
        require(self.obstacles in (1, 2), "obstacles", self.obstacles, "1 or 2")
        is_within = 0 < self.period <= _MAX_PERIOD
        samples = self.period / SAMPLE
        is_multiple = is_within and abs(samples - round(samples)) < _ROUNDING
        require(is_multiple, "period", self.period, f"a multiple of {SAMPLE} s, up to 1 s")

    @property
    def courses(self) -> tuple[str | Course, ...]:
        """Courses from which episodes draw."""
        return (self.course,) if isinstance(self.course, str | Course) else tuple(self.course)
