"""A robot at the start of a course, and its driver, from the options of `trackslip drive`."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from experiments.common.plain_json import plain
from experiments.drive.config import Config
from experiments.drive.course import PERIOD, Driver
from experiments.simulate.options import speed_or_usual
from sim.common.seeds import generator
from sim.motors.motor import or_tireless
from sim.policy import Policy
from sim.robot.named import load_tracked
from sim.robot.tracked import TrackedRobot
from sim.terrain import Course, load_course
from sim.traverse.config import CrossingLayout
from sim.traverse.courses import FTR_COURSES, draw_course
from sim.traverse.ground import Footprint
from sim.traverse.outcome import Limits
from sim.traverse.policy import reflex
from sim.traverse.task import Actions
from sim.traverse.world import Command, Traverse
from trackslip.controllers.steering import PurePursuit
from trackslip.errors import InvalidValueError, require
from trackslip.kinematics import Array, limit_sprocket_speeds, track_speeds
from trackslip.trajectory.path import MotionLimits
from trackslip.trajectory.turns import turns_of
from trackslip.trajectory.waypoints import TOLERANCE_SHARE, read_waypoints

SAMPLE: Final = 0.004  # time between changes of the belts' speeds [s]
ACCELERATION: Final = 2.0  # acceleration at both ends of a path [m/s^2]
# number of periods ahead on the path that are searched for the point beside the robot
_SEARCH: Final = 200


def make_world(config: Config) -> Traverse:
    """A robot at the start of a course; raises TrackslipError for a robot or a course that can't be
    built.
    """
    robot = load_tracked(config.robot)
    course = _course(config, robot, config.seed)
    if config.seed is not None:
        other = _course(config, robot, config.seed + 1)
        is_random = plain(other.solids) != plain(course.solids)
        require(is_random, "seed", config.seed, "left out: the course has no random parts")
    course = Footprint.of(robot).fit(course)
    if config.friction is not None:
        allowed = "left out: the course states its friction across the tracks, too"
        require(not course.is_plane, "friction", config.friction, allowed)
        course = replace(course, friction=config.friction)
    return Traverse(
        robot,
        [course],
        preset=config.preset,
        top_speed=_top_speed(config, robot),
        limits=Limits(time=config.duration),
        period=PERIOD,
        sample=SAMPLE,
        threads=1,
    )


def _top_speed(config: Config, robot: TrackedRobot) -> float:
    """Top speed of the belts, the robot's own; belts without motors are as fast as they are told to
    be [m/s].
    """
    own = or_tireless(robot.drive).top_speed
    speed = speed_or_usual(config.speed, own)
    fastest = abs(speed) + abs(config.turn) * robot.half_gauge
    if robot.drive is None:
        return max(own, fastest)
    if config.policy is None:
        allowed = f"for belts of at most the robot's top speed, {own:g} m/s"
        if config.turn == 0:
            require(fastest <= own, "speed", speed, allowed)
        else:
            require(fastest <= own, "speed, turn", (speed, config.turn), allowed)
    return own


def _course(config: Config, robot: TrackedRobot, seed: int | None) -> Course:
    """The course with its random parts drawn by `seed`; None for the course's own seed."""
    if config.course not in FTR_COURSES:
        return load_course(config.course, seed, FTR_COURSES)
    rng = generator(seed or 0, config.course)
    drawn = draw_course(config.course, config.difficulty, rng, robot.hull)
    return replace(drawn, seed=seed or 0)


def driver(config: Config, world: Traverse) -> Driver:
    """The driver: a policy, a path follower, or constant speeds; flippers by reflex or at the
    requested angles.
    """
    if config.policy is not None:
        return PolicyDriver(Policy.load(config.policy), world)
    half_gauge = world.tracked.robot.half_gauge
    asked = config.flipper_angles()
    front, rear = asked or (0.0, 0.0)
    fixed = np.where(world.tracked.flippers.front, front, rear)[None]

    def angles(world: Traverse) -> Array:
        return reflex(world) if asked is None else fixed

    speed = speed_or_usual(config.speed, world.top_speed)
    if config.path is not None:
        return PathDriver(config.path, speed, half_gauge, angles)
    speeds = track_speeds([[speed, config.turn]], half_gauge)
    return lambda world: Command(speeds, angles(world))


class PolicyDriver:
    """A policy as driver, with the observations and actions of the environment that it was trained
    in.
    """

    def __init__(self, policy: Policy, world: Traverse) -> None:
        """Raises InvalidValueError for a policy that was trained for another robot."""
        options = policy.environment()
        self._policy = policy
        self._actions = Actions(options, world)
        self._layout = CrossingLayout(world, options.noise)
        self._every = round(options.period / PERIOD)
        self._require_fit()
        self._rows = 0
        self._command = Command(np.zeros((1, 2)), world.flipper_servo.angle)

    def _require_fit(self) -> None:
        """Raise InvalidValueError unless the network has this robot's observations and actions."""
        shape = self._policy.network.shape
        inputs = len(self._layout.elements)
        outputs = len(self._actions.elements)
        allowed = f"from {inputs} inputs to {outputs}"
        require(shape == (inputs, outputs), "policy", shape, allowed)

    def __call__(self, world: Traverse) -> Command:
        """Set points from the policy, renewed at the policy's period."""
        if self._rows % self._every == 0:
            observation = self._layout.observation(world, [0])
            action = self._policy.action(observation)
            self._command = self._actions.command(action)
        self._rows += 1
        return self._command


class PathDriver:
    """Pure pursuit of waypoints using the true pose, at the speed that the reference has beside the
    robot.
    """

    def __init__(
        self, path: Path, speed: float, half_gauge: float, flippers: Callable[[Traverse], Array]
    ) -> None:
        """Raises ReferenceFileError for waypoints that can't be followed with belt speeds up to
        `speed` [m/s].
        """
        limits = MotionLimits(
            speed, ACCELERATION, speed / half_gauge, track_speed=speed, half_gauge=half_gauge
        )
        self.reference = read_waypoints(path, limits, TOLERANCE_SHARE * half_gauge)
        turns = turns_of(self.reference)
        if turns:
            allowed = f"without the turn on the spot at {turns[0]}: pure pursuit can't turn there"
            raise InvalidValueError("path", str(path), allowed)
        duration = self.reference.duration
        self._times = np.append(np.arange(PERIOD, duration, PERIOD), duration)
        self._points = self.reference.pose(self._times)[:, :2]
        self._beside = 0  # index of the point beside the robot
        self._controller = PurePursuit()
        self._flippers = flippers
        self._speed = speed
        self._half_gauge = half_gauge

    def __call__(self, world: Traverse) -> Command | None:
        """Set points that follow the path; None when the robot is beside the end of the path."""
        position = world.state.position[:, :2]
        ahead = self._points[self._beside : self._beside + _SEARCH]
        distance = np.hypot(*(ahead - position).T)
        self._beside += int(np.argmin(distance))
        if self._beside >= len(self._times) - 2:  # where the reference hardly moves
            return None
        pose = np.column_stack([position, world.state.heading])
        twist = self._controller.twist(self._times[self._beside], pose, self.reference)
        wanted = track_speeds(twist, self._half_gauge)
        speeds = limit_sprocket_speeds(wanted, self._speed)
        return Command(speeds, self._flippers(world))


def about_world(world: Traverse) -> dict[str, Any]:
    """Metadata for a run: properties of robot and course that the options do not determine."""
    robot = world.tracked.robot
    course = world.course[0]
    tracked = world.tracked
    return {
        "geometry": {
            "half_gauge": robot.half_gauge,
            "sprocket_radius": robot.sprocket_radius,
        },
        "robot": {
            **plain(robot),
            "model": robot.model.name,
            "packages": [each.name for each in robot.packages],
        },
        "course": {
            "friction": course.friction,
            "friction_across": course.friction_across,
            "seed": course.seed,
            "width": course.width,
            "goal": float(world.goal[0]),
        },
        "seed": course.seed,
        "mass": float(tracked.model.body_subtreemass[tracked.body]),
    }
