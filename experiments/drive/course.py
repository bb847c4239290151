"""One robot driven over a course, and the record of its drive."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from sim.engine.simulations import States
from sim.motors.belt_motors import MotorReading
from sim.robot.tracked import TrackedRobot
from sim.runs.run_recorder import Saturation
from sim.terrain import Course
from sim.tracks import Reading
from sim.traverse.outcome import Outcome
from sim.traverse.world import Command, Traverse
from trackslip.kinematics import Array

Driver = Callable[[Traverse], Command | None]
"""A function that returns the set points for a world with one robot; None ends the run."""
PERIOD: Final = 0.02  # time between set points, and between rows of a run [s]
STOPPED: Final = "stopped"  # outcome of a run that its driver ended, at the end of a path
_SIDE_POINTS: Final = 11  # number of points along each track, for the slope of the ground


@dataclass(frozen=True)
class DrivenCourse:
    """The record of a drive: R rows, the first of which is at rest, for T tracks and F flippers."""

    robot: TrackedRobot
    course: Course
    goal: float  # x at which the course is crossed [m]
    tracks: tuple[str, ...]  # names (T,)
    sides: tuple[int, int]  # indices of a track on the left and of one on the right
    flippers: tuple[str, ...]  # names (F,)
    outcome: str
    """Outcome: reached, tipped, stuck, fell, exploded, time, or stopped."""
    time: Array  # (R,) since the start [s]
    state: States  # (R, ...)
    angles: Array  # (R, F) flipper angles, positive with the tips up [rad]
    command: Command  # (R, ...)
    work: Array  # (R, T) work of the belts against the ground since the previous row [J]
    motors: MotorReading  # (R, M) of the left and right motors, and one in the middle, if any
    contact: Reading  # (R, T) means since the previous row

    @property
    def travel(self) -> Array:
        """Distances (R, T) travelled by the belts since the start [m]."""
        period = np.diff(self.time, prepend=0.0)[:, None]
        return np.cumsum(self.contact.belt * period, axis=0)

    @property
    def saturation(self) -> Saturation | None:
        """The motor that was at its limit for longer; None if none was."""
        if len(self.time) < 2:
            return None
        motors = self.motors
        period = np.diff(self.time)[:, None]
        share = np.diff(motors.saturated_time, axis=0) / period
        return Saturation.of(share, motors.saturated_torque[1:], motors.needed[1:])

    @property
    def attitude(self) -> Array:
        """Pitch, roll and slope of the ground (R, 3) [deg]."""
        return np.degrees([self.state.pitch, self.state.roll, self.slope]).T

    @cached_property
    def slope(self) -> Array:
        """Slopes (R,) along the robot of a line fitted to the ground under its tracks, positive
        uphill [rad].
        """
        # P points along the left and the right track, in the robot's frame
        hull = np.array(self.robot.hull)
        rear = hull[:, 0].min()
        front = hull[:, 0].max()
        along = np.linspace(rear, front, _SIDE_POINTS)  # (P,)
        across = self.robot.half_gauge * np.array([[1.0], [-1.0]])  # (2, 1)

        # the same points on the course, (R, 2, P)
        heading = self.state.heading[:, None, None]
        middle_x = self.state.position[:, 0, None, None]
        middle_y = self.state.position[:, 1, None, None]
        x = middle_x + along * np.cos(heading) - across * np.sin(heading)
        y = middle_y + along * np.sin(heading) + across * np.cos(heading)

        # the line by least squares, through the mean height of both tracks
        height = self.course.height(x, y).mean(axis=1)  # (R, P)
        offset = along - along.mean()
        gradient = (height * offset).sum(axis=-1) / (offset**2).sum()
        return np.asarray(np.arctan(gradient))


def drive_course(
    world: Traverse, driver: Driver, progress: Callable[[float], None] = lambda seconds: None
) -> DrivenCourse:
    """Drive until there is an outcome or the driver returns None; `progress` is called with newly
    simulated seconds.
    """
    at_rest = Command(np.zeros((1, 2)), world.flipper_servo.angle)
    rows = [_row(world, at_rest)]
    while world.outcome[0] == Outcome.DRIVING and (command := driver(world)) is not None:
        world.step(command)
        rows.append(_row(world, command))
        progress(world.period)

    outcome = Outcome(int(world.outcome[0]))
    columns = {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}
    qpos = columns["qpos"]
    contact = {name: columns[name] for name in Reading.__dataclass_fields__}
    motors = {name: columns[f"motor_{name}"] for name in MotorReading.__dataclass_fields__}
    tracked = world.tracked
    return DrivenCourse(
        robot=tracked.robot,
        course=world.course[0],
        goal=float(world.goal[0]),
        tracks=tuple(world.track_names),
        sides=tracked.side_tracks,
        flippers=tracked.flipper_names,
        outcome=STOPPED if outcome == Outcome.DRIVING else outcome.label,
        time=columns["time"],
        state=States(qpos, columns["qvel"], tracked.free),
        angles=tracked.flipper_angles(qpos),
        command=Command(columns["speed"], columns["flippers"]),
        work=columns["work"],
        motors=MotorReading(**motors),
        contact=Reading(**contact),
    )


def _row(world: Traverse, command: Command) -> dict[str, Array]:
    """Copies of time, state, command, work, motors and contact at the end of a control period."""
    motors = {f"motor_{name}": values for name, values in vars(world.motors()).items()}
    row = {"time": world.time, "qpos": world.state.qpos, "qvel": world.state.qvel}
    row |= vars(command)
    row["work"] = world.work
    row |= motors
    row |= vars(world.contact)
    return {name: np.array(values) for name, values in row.items()}
