"""Batched simulation of N tracked robots, each crossing its own course, one control period at a
time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from mujoco import mjtWarning
from numpy.typing import ArrayLike, NDArray

from sim.common.settings import converted
from sim.engine.simulations import Simulations, quietly, steps_in
from sim.motors.belt_motors import MotorReading
from sim.motors.motor import or_tireless
from sim.motors.servo import FlipperServo, Servo
from sim.robot.tracked import TrackedRobot
from sim.robot.tracked_model import build_tracked, clear_angles
from sim.robot.urdf import engine_errors
from sim.terrain.course import Course, look_up
from sim.tracks import Reading
from sim.traverse.ground import Footprint, Slots
from sim.traverse.outcome import Limits, Outcome, Outcomes, StuckWatch
from trackslip import se2
from trackslip.arguments import checks_arguments
from trackslip.errors import require, require_positive
from trackslip.kinematics import Array

# warnings of the engine about a state that diverges
_DIVERGING: Final = [
    int(mjtWarning.mjWARN_BADQPOS),
    int(mjtWarning.mjWARN_BADQVEL),
    int(mjtWarning.mjWARN_BADQACC),
]
_DROP: Final = 0.3  # depth below the course's lowest ground at which a robot has fallen [m]
_LEAN: Final = 1.3  # lean of the chassis beyond which a robot has tipped over [rad]
_FASTEST: Final = 10.0  # chassis speed beyond which the simulation has diverged [m/s]
_GAP: Final = 0.002  # height above the ground at which robots are placed [m]
# Least moment of inertia of a side's motor and belts, relative to the robot's mass times the square
# of the sprocket's radius [-]. Real ones have 0.1 to 0.3. Without any, belts that slide have no
# speed of their own: where the ground's forces are rough, as in an impact, they run away.
_LEAST_INERTIA: Final = 0.005
_SPACING: Final = 0.05  # largest spacing of the points in a search for the highest ground [m]


@dataclass(frozen=True)
class Command:
    """Set points for N robots."""

    speed: Array  # (N, 2) belt speeds, left and right [m/s]
    flippers: Array  # (N, F) angles, tips up [rad]


@checks_arguments
class Traverse(Simulations):
    """N robots on courses. Rows are bitwise independent of each other and of the number of
    threads.
    """

    STATE = (
        "servo",
        "flipper_servo",
        "work",
        "outcome",
        "time",
        "_stuck",
        "_bottom",
        "_side",
        "goal",
    )

    def __init__(
        self,
        robot: TrackedRobot,
        courses: Sequence[Course],
        size: int = 1,
        *,
        boxes: int = 0,
        preset: str = "fast",
        top_speed: float | None = None,
        limits: Limits | None = None,
        period: float = 0.1,
        sample: float = 0.02,
        threads: int = 0,
    ) -> None:
        """Prepare `size` robots; `begin` starts their runs.

        Args:
            robot: the robot; without a drive of its own, the torque of its belts is unlimited.
            courses: courses on which runs may take place.
            size: number of robots.
            boxes: largest number of boxes on other courses that are allowed, too, if they have no
                height fields.
            preset: contact preset of the tracks.
            top_speed: top speed of the belts; by default the robot's, 0.6 without a drive [m/s].
            limits: the limits that end a run.
            period: time between set points [s].
            sample: time between changes in the belt speeds [s].
            threads: number of worker threads, 0 for one per processor.

        Raises:
            InvalidValueError: for values out of range, and unless `period` is a multiple of
                `sample`, and `sample` a multiple of the physics step.
        """
        require(len(courses) > 0, "courses", list(courses), "at least one")
        if top_speed is not None:
            require_positive("top_speed", top_speed)
        self.slots = Slots(courses, boxes)
        """The terrain in the model."""
        self.tracked = build_tracked(
            robot, self.slots, preset=preset, friction=self.slots.frictions
        )
        """The compiled robot."""
        robot = self.tracked.robot
        model = self.tracked.model
        belts = self.tracked.belts
        with engine_errors(robot.model):
            super().__init__(model, size, threads, self.tracked.free)
        self.period = period
        """Time between set points [s]."""
        self.sample = sample
        """Time between changes in the belt speeds [s]."""
        self.limits = limits or Limits()
        """The limits that end a run."""
        self._substeps = steps_in("sample", sample, "the physics step", float(model.opt.timestep))
        self._samples = steps_in("period", period, "sample", sample)
        self.track_names = belts.names
        """Names of the tracks (T,)."""
        law = None if robot.drive is None else robot.drive.motor
        self._belts = belts.bind_batch(
            self.batch, self.tracked.track_side, law, robot.sprocket_radius
        )
        drive = or_tireless(robot.drive)
        self._lag = drive.lag
        mass = float(model.body_subtreemass[self.tracked.body])
        least = _LEAST_INERTIA * mass * robot.sprocket_radius**2
        self._inertia = max(drive.motor.inertia, least)
        self.top_speed = drive.top_speed if top_speed is None else top_speed
        """Top speed of the belts [m/s]."""
        self._friction = self.batch.expand("pair_friction")  # (N, npair, 5), a view of the batch
        self._terrain_pairs = self.slots.pairs(model)
        along, across = self.slots.frictions
        self._is_anisotropic = along != across
        # (P,) whether the first direction of a pair's contacts is across the track
        self._is_lateral = model.pair_friction[self._terrain_pairs, 0] != along
        self.slots.bind_batch(self.batch)
        self.flippers = self.tracked.flippers
        self.footprint = Footprint.of(robot, self.flippers)
        with engine_errors(robot.model):
            self._clear = clear_angles(self.tracked)
        self.servo = Servo(size, self._lag, sample, self.top_speed)
        """Servos of the belts, with the belt speeds [m/s]."""
        self.flipper_servo = FlipperServo(size, len(self.flippers.length))
        """Set points of the flippers' motors."""
        self.contact = Reading.none(size, len(self.track_names))
        """Means of the track contacts (N, T) over the last control period."""
        self.work: Array = np.zeros((size, len(self.track_names)))
        """Work (N, T) of the belts on the ground in the last control period [J]."""
        self._courses = tuple(courses)
        self.course: list[Course] = [courses[0]] * size
        """Courses of the robots, by row."""
        self._stuck = StuckWatch(self.limits, size, period)
        self.outcome: Outcomes = np.full(size, Outcome.DRIVING)
        """Outcomes (N,) of the present runs."""
        self.time: Array = np.zeros(size)
        """Times (N,) since the runs began [s]."""
        self._bottom: Array = np.zeros(size)  # height below which a robot has fallen [m]
        # distance from y = 0 beyond which a robot has fallen as well [m]
        self._side: Array = np.zeros(size)
        self.goal: Array = np.zeros(size)
        """Positions x (N,) beyond which courses are crossed [m]."""
        self.begin(np.arange(size))

    def begin(
        self,
        rows: ArrayLike,
        courses: Sequence[Course] | None = None,
        start: ArrayLike | None = None,
        mass: ArrayLike = 1.0,
    ) -> None:
        """Begin runs with the robots `rows` (R,); flippers are level, or raised just enough to
        clear level ground.

        Args:
            rows: indices of the robots.
            courses: one course per robot; by default each robot stays on its present course.
            start: poses (R, 3), x, y and heading; by default each robot starts before its first
                piece [m, m, rad].
            mass: factors on the mass and inertia of the chassis, a scalar or (R,) [-].

        Raises:
            InvalidValueError: for a course that doesn't fit into the slots, poses that aren't
                finite, and a robot that needs a larger start platform; see `Footprint.fit`.
        """
        where = np.asarray(rows, int)
        count = len(where)
        if not count:
            return
        chosen = [self.course[row] for row in where] if courses is None else list(courses)
        given = f"{len(chosen)} courses"
        require(len(chosen) == count, "courses", given, f"{count}, one for each robot")
        if start is None:
            start = [self._start(course) for course in chosen]
        poses = np.array(start, float)
        valid = poses.shape == (count, 3) and np.isfinite(poses).all()
        allowed = f"finite poses (x, y, heading), one for each of {count} robots"
        require(valid, "start", poses.tolist(), allowed)
        for row, course in zip(where, chosen, strict=True):
            self._lay(int(row), course)
        self.servo.begin(where, [self._lag] * count)
        self.flipper_servo.begin(where, self._clear)
        factors = np.broadcast_to(np.asarray(mass, float), where.shape)
        for factor in factors:
            require_positive("mass", factor)
        # `_set_payload` needs moving belts
        self._belts.set(self.tracked.motor_speeds(np.ones((count, 2))), where)
        with engine_errors(self.tracked.robot.model):
            self._set_payload(where, self.tracked.body, factors, np.zeros((count, 2)))
        self._place(where, poses)
        self._belts.begin(where)
        self._stuck.begin(where)
        self.contact.put(where, Reading.none(count, len(self.track_names)))
        self.work[where] = 0.0
        self.outcome[where] = Outcome.DRIVING
        self.time[where] = 0.0

    def _start(self, course: Course) -> tuple[float, float, float]:
        """Start pose (x, y, heading) on a course [m, m, rad]."""
        _, y, _, heading = course.start
        return self.footprint.start(course), y, heading

    def get_state(self) -> dict[str, Any]:
        """Return a copy of the state, see Restorable; courses given to the constructor are stored
        as indices.
        """
        number = {id(course): k for k, course in enumerate(self._courses)}
        courses = tuple(number.get(id(course), course) for course in self.course)
        contact = {name: values.copy() for name, values in vars(self.contact).items()}
        others = {"courses": courses, "belts": self._belts.get_state(), "contact": contact}
        return super().get_state() | others

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a state from `get_state`, see Restorable."""
        super().set_state(state)
        self._belts.set_state(state["belts"])
        self.contact.put(slice(None), Reading(**state["contact"]))
        self.course = [self._stored_course(course) for course in state["courses"]]

    def _stored_course(self, course: Any) -> Course:
        """A course of a state: the index of one given to the constructor, or the course itself."""
        if isinstance(course, int):
            return self._courses[course]
        stored: Course = converted("course", course, Course)
        return stored

    def step(self, command: Command) -> None:
        """Simulate one control period for the robots whose runs have not ended.

        Raises InvalidValueError for set points that aren't finite or have a wrong shape.
        """
        _require_set_points("speed", command.speed, self.servo.speed.shape)
        _require_set_points("flippers", command.flippers, self.flipper_servo.angle.shape)
        self.work[:] = 0.0  # also of robots whose simulation diverges in this period
        rows = np.flatnonzero(self.outcome == Outcome.DRIVING)
        if not rows.size:
            return
        self.servo.command(np.asarray(command.speed, float))
        self.flipper_servo.command(command.flippers)
        before = self.batch.state.copy()
        readings = []
        # a diverging run ends with the outcome EXPLODED
        with quietly(), engine_errors(self.tracked.robot.model):
            for _ in range(self._samples):
                self.flipper_servo.advance(self.sample)
                control = self.tracked.flipper_control(self.flipper_servo.angle)
                self.batch.ctrl[:, self.tracked.flipper_motor] = control
                readings.append(self._drive(rows))
        self.time[rows] += self.period

        # diverged runs return to their last finite state
        broken = self._broken(rows)
        self.batch.state[broken] = before[broken]
        fine = ~broken[rows]
        reading = Reading.joined(readings)[fine].complete(self.track_names)
        self.contact.put(rows[fine], reading.mean())
        power = reading.traction * reading.belt
        self.work[rows[fine]] = power.sum(axis=1) * self.tracked.model.opt.timestep
        self._judge(rows, broken)

    def _drive(self, rows: NDArray[np.int_]) -> Reading:
        """Simulate a sample with the robots `rows` (R,), and return the belts' contacts (R, steps,
        T).
        """
        goal = self.servo.advance()
        motors = self.tracked.motor_speeds(goal)
        drive = self.tracked.robot.drive
        if drive is None:
            self._belts.set(motors)
            return self._belts.run(self._substeps, rows)
        self._belts.set(motors, torque_limit=drive.torque_limit, inertia=self._inertia)
        reading = self._belts.run(self._substeps, rows)

        # a servo whose motor is too weak goes on from the belt's real speed, unless that diverges
        speed = goal.copy()
        driven = min(motors.shape[1], speed.shape[1])
        speed[:, :driven] = self._belts.motors().speed[:, :driven]
        is_weak = np.zeros(speed.shape, bool)
        is_weak[rows] = (speed[rows] != goal[rows]) & np.isfinite(speed[rows])
        self.servo.correct(is_weak, speed)
        return reading

    def motors(self) -> MotorReading:
        """Torque, speed, power and energy (N, 2) of the left and right motors after the last
        `step`, (N, 3) if a belt has a motor of its own; the torques of belts without motors are 0.
        """
        return self._belts.motors()

    def elevation(self, points: Array) -> Array:
        """Ground heights (N, P) at `points` (N, P, 2) on each robot's course [m]."""
        return look_up(self.course, points)

    @property
    def distance_to_goal(self) -> Array:
        """Distances (N,) along x that remain until courses are crossed [m]."""
        return self.goal - self.state.position[:, 0]

    def _lay(self, row: int, course: Course) -> None:
        self.slots.lay(row, course)
        self.course[row] = course
        along, across = course.frictions
        allowed = "equal to that along, as on the first of the world's courses"
        require(self._is_anisotropic or along == across, "friction_across", across, allowed)
        # other pairs, such as those in the robot's own model, keep their friction
        first = np.where(self._is_lateral, across, along)
        second = np.where(self._is_lateral, along, across)
        self._friction[row, self._terrain_pairs, :2] = np.stack([first, second], axis=1)
        bounds = course.bounds
        self._bottom[row] = bounds[0, 2] - _DROP
        self._side[row] = np.abs(bounds[:, 1]).max()
        self.goal[row] = self.footprint.goal(course)

    def _place(self, rows: NDArray[np.int_], poses: Array) -> None:
        """Place the robots `rows` (R,), level and at rest, at poses (R, 3) on the highest ground
        below each of them.
        """
        self.batch.warning[rows] = 0
        footprint = self.footprint
        x = _spaced(-footprint.behind, footprint.ahead)
        y = _spaced(-footprint.aside, footprint.aside)
        in_robot = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        below = se2.to_world(poses[:, None], in_robot)
        courses = [self.course[row] for row in rows]
        ground = look_up(courses, below).max(axis=1)
        self._place_at(rows, poses, ground - self.tracked.robot.lowest + _GAP)
        angle = self.tracked.flipper_control(self.flipper_servo.angle[rows])
        self.batch.qpos[rows[:, None], self.tracked.flipper_qpos] = angle

    def _broken(self, rows: NDArray[np.int_]) -> NDArray[np.bool_]:
        """Mask (N,) of the robots whose simulation diverged in this period; `rows` (R,) are those
        that drove.
        """
        qpos = self.batch.qpos[rows]
        qvel = self.batch.qvel[rows]
        has_warned = self.batch.warning[rows][:, _DIVERGING, 1].any(axis=1)
        is_finite = np.isfinite(qpos).all(axis=1) & np.isfinite(qvel).all(axis=1)
        first = self.tracked.free[1]
        speed = np.linalg.norm(qvel[:, first : first + 3], axis=1)
        is_slow = speed < _FASTEST
        broken = np.zeros(self.size, bool)
        broken[rows] = has_warned | ~is_finite | ~is_slow
        return broken

    def _judge(self, rows: NDArray[np.int_], broken: NDArray[np.bool_]) -> None:
        """Determine the outcomes of the robots `rows` (R,) that drove in this period.

        If several outcomes apply, the last of them in the order of `Outcome` counts.
        """
        state = self.state
        is_below = state.position[:, 2] < self._bottom
        is_beside = np.abs(state.position[:, 1]) > self._side
        applies = {
            Outcome.TIME: self.time > self.limits.time - self.period / 2,
            Outcome.STUCK: self._stuck.observe(state.position, self.servo.speed),
            Outcome.REACHED: self.distance_to_goal <= 0,
            Outcome.FELL: is_below | is_beside,
            Outcome.TIPPED: state.upright < np.cos(_LEAN),
            Outcome.EXPLODED: broken,
        }
        for outcome in sorted(applies):
            judged = rows[applies[outcome][rows]]
            self.outcome[judged] = outcome


def _require_set_points(name: str, values: Array, shape: tuple[int, ...]) -> None:
    valid = np.shape(values) == shape and np.isfinite(values).all()
    require(valid, name, np.asarray(values).tolist(), f"finite, of shape {shape}")


def _spaced(low: float, high: float) -> Array:
    """Places from `low` to `high` that are at most _SPACING apart [m]."""
    count = math.ceil((high - low) / _SPACING) + 1
    return np.linspace(low, high, count)
