"""One robot driven over a course: its drivers, and what is recorded of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.robot.tracked import TrackedRobot
from sim.terrain import Course
from sim.traverse.outcome import Outcome
from sim.traverse.states import States
from sim.traverse.world import Command, Traverse
from trackslip.kinematics import Array
from trackslip.metrics import body_errors
from trackslip.trajectory.waypoints import read_waypoints

PERIOD = 0.02
"""Time between set points, and between rows of a run [s]."""
SAMPLE = 0.004
"""Time between looks at the contacts [s]."""
STOPPED = "stopped"
"""Outcome of a run that its driver ended."""
_SIDE_POINTS = 11  # along each track, that the slope of the ground is taken from
_SPACING = 0.02  # of the points of a path [m]
_SEARCH = 1.0  # how far ahead on a path the robot is looked for [m]
_SHARPEST = 4.0  # curvature of an arc towards a path [1/m]


Pilot = Callable[[States], Array | None]
"""Gives the belt speeds (2,), left and right, of the robot in row 0 of a state [m/s]; None once nothing is left."""


@dataclass
class PathPilot:
    """Pure pursuit of a path by the true position: an arc towards the point `look_ahead` further on (Coulter, 1992)."""

    points: Array  # (P, 2) along the path, evenly spaced [m]
    speed: float  # of the robot, if it didn't slip [m/s]
    half_gauge: float  # half the distance between the tracks [m]
    look_ahead: float = 0.5  # distance along the path of the point that the robot drives to [m]
    _at: int = field(default=0, init=False)  # index of the point that the robot has reached

    @classmethod
    def of(cls, path: Path, speed: float, half_gauge: float) -> PathPilot:
        """Follow the waypoints in a .csv file; raises ReferenceFileError if they can't be driven."""
        reference = read_waypoints(path)
        dense = reference.pose(np.linspace(0.0, reference.duration, 20_000))[:, :2]
        length = np.append(0.0, np.cumsum(np.hypot(*np.diff(dense, axis=0).T)))
        even = np.linspace(0.0, length[-1], max(2, round(length[-1] / _SPACING) + 1))
        points = np.stack([np.interp(even, length, column) for column in dense.T], axis=-1)
        return cls(points, speed, half_gauge)

    def __call__(self, state: States) -> Array | None:
        """See `Pilot`."""
        here, heading = state.position[0, :2], float(state.heading[0])
        ahead = self.points[self._at : self._at + round(_SEARCH / _SPACING)]
        self._at += int(np.argmin(np.hypot(*(ahead - here).T)))
        if self._at >= len(self.points) - 1:
            return None
        goal = self.points[min(self._at + round(self.look_ahead / _SPACING), len(self.points) - 1)]
        along, across, _ = body_errors([*here, heading], [*goal, heading])
        distance = max(float(np.hypot(along, across)), self.look_ahead / 2)
        curvature = float(np.clip(2 * across / distance**2, -_SHARPEST, _SHARPEST))
        if along < 0:  # the goal lies behind: turn on the spot
            return self.speed * np.sign(across) * np.array([-1.0, 1.0])
        outer = 1 + abs(curvature) * self.half_gauge  # the faster belt runs at the set speed
        return np.asarray(self.speed / outer * (1 + curvature * self.half_gauge * np.array([-1.0, 1.0])))


@dataclass(frozen=True)
class DrivenCourse:
    """A drive of R rows, the first at rest; T tracks and F flippers. Means are those since the previous row."""

    robot: TrackedRobot
    course: Course
    outcome: str
    """Outcome: reached, tipped, stuck, fell, exploded, time, or stopped."""
    state: States
    time: Array  # (R,) since the start [s]
    command: Array  # (R, 2) belt speeds asked for, left and right [m/s]
    flipper_command: Array  # (R, F) set points of the flippers, tips up [rad]
    belt: Array  # (R, T) mean speeds of the belts [m/s]
    traction: Array  # (R, T) mean force of the ground along the belt [N]
    load: Array  # (R, T) mean normal force [N]
    slip: Array  # (R, T) NaN where a track doesn't touch or stands [-]
    touching: NDArray[np.bool_]  # (R, T)
    depth: Array  # (R, T) largest penetration [m]
    work: Array  # (R, T) of the belts against the ground [J]
    tracks: tuple[str, ...]  # names (T,)

    @property
    def flippers(self) -> list[str]:
        """Names of the flippers (F,)."""
        return [flipper.body for flipper in self.robot.flippers]

    @property
    def travel(self) -> Array:
        """Distances (R, T) that the belts have run since the start [m]."""
        return np.cumsum(self.belt * np.diff(self.time, prepend=0.0)[:, None], axis=0)

    @property
    def attitude(self) -> Array:
        """Pitch, roll and slope of the ground (R, 3) [rad]."""
        return np.stack([self.state.pitch, self.state.roll, self.slope], axis=-1)

    @cached_property
    def slope(self) -> Array:
        """Slopes (R,) along the robot of the line that fits the ground under its tracks best, positive uphill [rad]."""
        hull = np.array(self.robot.hull)
        along = np.linspace(hull[:, 0].min(), hull[:, 0].max(), _SIDE_POINTS)
        heading = self.state.heading[:, None, None]
        across = self.robot.half_gauge * np.array([1.0, -1.0])[:, None]
        x = self.state.position[:, 0, None, None] + along * np.cos(heading) - across * np.sin(heading)
        y = self.state.position[:, 1, None, None] + along * np.sin(heading) + across * np.cos(heading)
        height = self.course.height(x, y).mean(axis=1)  # (R, P)
        offset = along - along.mean()
        return np.asarray(np.arctan((height * offset).sum(axis=-1) / (offset**2).sum()))


def drive_course(
    world: Traverse,
    pilot: Pilot,
    flippers: Callable[[Traverse], Array],
    progress: Callable[[float], None] = lambda seconds: None,
    watch: Callable[[Traverse], bool] = lambda world: True,
) -> DrivenCourse:
    """Drive the first robot of `world` until its run ends; without reference and scanner, it is no run of `sim.loop`.

    Args:
        world: one robot at the start of a course.
        pilot: gives the belts their speeds.
        flippers: gives the flippers their angles (F,) [rad].
        progress: called with the seconds simulated since the last call.
        watch: called after each row; the run is stopped when it returns False.
    """
    rows = [_row(world, np.zeros(2), world.servo.angle[0])]
    outcome = ""
    while not outcome:
        speeds, angles = pilot(world.state), flippers(world)
        if speeds is None:
            outcome = Outcome.REACHED.label
            break
        world.step(Command(speeds[None], angles[None]))
        rows.append(_row(world, speeds, angles))
        progress(world.period)
        if not watch(world):
            outcome = STOPPED
        if world.outcome[0] != Outcome.DRIVING:
            outcome = Outcome(int(world.outcome[0])).label
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    tracked = world.tracked
    return DrivenCourse(
        state=States(tracked, columns.pop("qpos"), columns.pop("qvel")),
        course=world.course[0],
        robot=tracked.robot,
        outcome=outcome,
        tracks=tuple(world.track_names),
        **columns,
    )


def _row(world: Traverse, speeds: Array, angles: Array) -> dict[str, Array]:
    """Record of the first robot at the end of a control period."""
    return {
        "time": world.time[0].copy(),
        "qpos": world.state.qpos[0].copy(),
        "qvel": world.state.qvel[0].copy(),
        "command": np.array(speeds, float),
        "flipper_command": np.array(angles, float),
        **{name: values[0].copy() for name, values in vars(world.contact).items()},
    }
