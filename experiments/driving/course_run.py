"""One robot driven over a course, and what was recorded of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.driving.course_pilots import CoursePilot
from sim.robot.tracked import TrackedRobot
from sim.terrain import Course
from sim.traverse.bodies import States
from sim.traverse.outcome import Outcome
from sim.traverse.reflex import Reflex
from sim.traverse.world import Command, Traverse
from trackslip.kinematics import Array

PERIOD = 0.02
"""Time between set points, and between rows of a run [s]."""
SAMPLE = 0.004
"""Time between looks at the contacts [s]."""
STOPPED = "stopped"
"""Outcome of a run that its driver ended."""
_SIDE_POINTS = 11  # along each track, that the slope of the ground is taken from


@dataclass(frozen=True)
class CourseRun:
    """A drive of R rows, the first at rest; T tracks and F flippers. Means are those since the previous row."""

    time: Array  # (R,) since the start [s]
    qpos: Array  # (R, nq) of the model
    qvel: Array  # (R, nv)
    state: States
    """Poses and velocities, from `qpos` and `qvel`."""
    command: Array  # (R, 2) belt speeds asked for, left and right [m/s]
    flipper_command: Array  # (R, F) set points of the flippers, tips up [rad]
    belt: Array  # (R, T) mean speeds of the belts [m/s]
    traction: Array  # (R, T) mean force of the ground along the belt [N]
    load: Array  # (R, T) mean normal force [N]
    slip: Array  # (R, T) NaN where a track doesn't touch or stands [-]
    touching: NDArray[np.bool_]  # (R, T)
    depth: Array  # (R, T) largest penetration [m]
    work: Array  # (R, T) of the belts against the ground [J]
    slope: Array  # (R,) of the ground under the tracks, along the robot, uphill is positive [rad]
    outcome: str
    """How it ended: reached, tipped, stuck, fell, exploded, time, or stopped."""
    tracks: tuple[str, ...]
    """Names of the tracks (T,)."""
    flippers: tuple[str, ...]
    """Names of the flippers (F,)."""

    @property
    def travel(self) -> Array:
        """(R, T) way of each belt since the start [m]."""
        return np.cumsum(self.belt * np.diff(self.time, prepend=0.0)[:, None], axis=0)


def drive_course(
    world: Traverse,
    pilot: CoursePilot,
    flippers: Callable[[Traverse], Array],
    each: Callable[[Traverse, CoursePilot], bool] = lambda *_: True,
) -> CourseRun:
    """Drive the first robot of `world` until its run ends.

    Args:
        world: one robot at the start of a course.
        pilot: gives the belts their speeds.
        flippers: gives the flippers their angles (F,) [rad].
        each: called after each row; the run is stopped when it returns False.
    """
    count = len(world.track_names)
    rows = [_row(world, np.zeros(2), world.servo.angle[0].copy())]
    outcome = ""
    while not outcome:
        speeds, angles = pilot.speeds(world.state), flippers(world)
        if speeds is None:
            outcome = Outcome.REACHED.label
            break
        world.step(Command(speeds[None], angles[None]))
        rows.append(_row(world, speeds, angles))
        if world.outcome[0] != Outcome.DRIVING:
            outcome = Outcome(int(world.outcome[0])).label
        elif not each(world, pilot):
            outcome = STOPPED
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    columns["touching"] = columns["touching"].astype(bool).reshape(-1, count)
    tracked = world.tracked
    state = States(tracked, columns["qpos"], columns["qvel"])
    names = tuple(flipper.body for flipper in tracked.robot.flippers)
    slope = ground_slope(world.course[0], state, tracked.robot)
    return CourseRun(
        state=state, slope=slope, outcome=outcome, tracks=tuple(world.track_names), flippers=names, **columns
    )


def reflexes(world: Traverse) -> Array:
    """Flippers' angles (F,) by reflex [rad]."""
    return world.reflex(Reflex())[0]


def ground_slope(course: Course, state: States, robot: TrackedRobot) -> Array:
    """Slopes (R,) of the ground along R robots, of the line that fits its heights under their tracks best [rad]."""
    hull = np.array(robot.hull)
    along = np.linspace(hull[:, 0].min(), hull[:, 0].max(), _SIDE_POINTS)
    level = state.heading[:, None, None]
    across = robot.half_gauge * np.array([1.0, -1.0])[:, None]
    x = state.position[:, 0, None, None] + along * np.cos(level) - across * np.sin(level)
    y = state.position[:, 1, None, None] + along * np.sin(level) + across * np.cos(level)
    height = course.height(x, y)  # (R, 2, P)
    offset = along - along.mean()
    return np.asarray(np.arctan((height.mean(axis=1) * offset).sum(axis=-1) / (offset**2).sum()))


def _row(world: Traverse, speeds: Array, angles: Array) -> dict[str, Array]:
    """What is recorded of the first robot at the end of a control period."""
    contact = world.contact
    measured = {name: getattr(contact, name)[0].copy() for name in ("traction", "load", "belt", "slip", "touching")}
    return {
        "time": world.time[0].copy(),
        "qpos": world.state.qpos[0].copy(),
        "qvel": world.state.qvel[0].copy(),
        "command": np.array(speeds, float),
        "flipper_command": np.array(angles, float),
        **measured,
        "depth": contact.depth[0].copy(),
        "work": contact.work[0].copy(),
    }
