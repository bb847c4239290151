"""Replays: simulated robots that repeat the drives in logs, one robot per log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np

from sim.fleet.fleet import Fleet
from sim.ground.ground import Ground
from sim.motors.motor import TOP_SPEED, Drive, tireless
from sim.robot.named import RobotSource, load_parameters
from sim.robot.parameters import RobotParameters
from sim.robot.robot import compiled
from trackslip import se2
from trackslip.arguments import checks_arguments
from trackslip.drives.conditioning import drives_of
from trackslip.drives.encoders import encoders_of
from trackslip.drives.first_look import first_look
from trackslip.errors import InvalidValueError, LogError, require_within
from trackslip.kinematics import Array, RobotGeometry, body_twist
from trackslip.logs.runlog import RunLog, Truth
from trackslip.se2 import Mounting

Inputs = Literal["encoders", "commands"]
"""Inputs to the simulated robots: measured sprocket speeds, or commands to the drive."""
RUN_UP: Final = 0.5
"""Time for which a robot drives at the first measured sprocket speeds before its log begins [s]."""
_FIRST: Final = 0.3  # duration of the first poses, which determine the initial twist [s]
_BEYOND: Final = 1e4  # time for which the last sprocket speeds continue after a log's end [s]
_ROUNDING: Final = 1e-9  # tolerance on times [s]
MAX_SPEED: Final = 9.9
"""Belt speed up to which drives can be replayed [m/s]."""
_MARGIN: Final = 1.01  # ratio of a replaying drive's top speed to the largest measured speed [-]


@dataclass(frozen=True)
class Replay:
    """Simulated motion of N robots, each of them timed by its log's encoder clock."""

    begin: Array  # (N,) start of the run-up [s]
    period: float  # time between states [s]
    pose: Array  # (P + 1, N, 3) poses, from the origin on [m, m, rad]
    twist: Array  # (P + 1, N, 3) forwards, to the left, yaw rate [m/s, rad/s]

    def at(self, robot: Any, time: Array) -> Array:
        """Poses (n, 3) of robots (n,) at times (n,), which are limited to the replay's duration."""
        return self._at(self.pose, robot, time)

    def sensor_at(self, robot: Any, sensor: Mounting, time: Array) -> Array:
        """Poses (n, 3) of the sensors on robots (n,) at times (n,)."""
        return se2.compose(self.at(robot, time), sensor.pose)

    def log(
        self, robot: int, of: RunLog, sensor: Mounting, clock: float, about: dict[str, Any]
    ) -> RunLog:
        """A log of the robot's motion, with the rows of `of` and metadata `about`; for the rest,
        see `replay`.
        """
        measured = np.flatnonzero(of.has_heading)
        row = int(measured[0]) if len(measured) else 0
        first = of.pose[row] if len(measured) else np.zeros(3)
        seen = self.sensor_at(robot, sensor, of.time + clock)
        # pose of the simulated world in the measured one
        frame = se2.compose(first, se2.inverse(seen[row]))
        truth = Truth(
            pose=se2.compose(frame, self.at(robot, of.time)),
            twist=self._at(self.twist, robot, of.time),
        )
        return RunLog(
            run=of.run,
            time=of.time,
            omega=of.omega,
            pose=se2.compose(frame, seen),
            command=of.command,
            read=of.read,
            truth=truth,
            metadata=about,
        )

    def _at(self, states: Array, robot: Any, time: Array) -> Array:
        """States (n, 3) of robots at times (n,), interpolated in `states` (P + 1, N, 3)."""
        last = len(states) - 1
        place = np.clip((time - self.begin[robot]) / self.period, 0, last)
        before = np.minimum(place.astype(int), last - 1)
        share = (place - before)[:, None]
        return np.asarray((1 - share) * states[before, robot] + share * states[before + 1, robot])


@checks_arguments
def replay(
    log: RunLog | Sequence[RunLog],
    robot: RobotSource,
    ground: Ground | None = None,
    *,
    inputs: Inputs = "encoders",
    sensor: Mounting | None = None,
    clock: float = 0.0,
    threads: int = 0,
) -> list[RunLog]:
    """Let simulated robots repeat the drives in logs.

    A replay begins with the twist in the first 0.3 s of poses, or at rest if the sprockets are at
    rest in this time.

    Args:
        log: a drive, or several drives, which are replayed independently.
        robot: the robot.
        ground: the ground; by default the one in the robot's file.
        inputs: "encoders" for measured sprocket speeds, averaged since the previous row, or
            "commands" for logged commands, each of which holds until the next one.
        sensor: position and yaw of the pose sensor on the robot; by default zero, at the robot's
            frame.
        clock: encoder clock minus pose clock, from -0.5 to 0.5 [s].
        threads: number of worker threads, 0 for one per processor.

    Returns:
        For each log, a log with the same rows: simulated sensor poses that begin at the first
        measured pose, measured sprocket speeds, and the robot's true pose and twist.

    Raises:
        LogError: for a log without commands if `inputs` is "commands", and for belt speeds above
            9.9 m/s.
        InvalidValueError: for arguments out of range.
    """
    require_within("clock", clock, -RUN_UP, RUN_UP, "s")
    logs = [log] if isinstance(log, RunLog) else list(log)
    parameters, file_ground = load_parameters(robot)
    ground = ground or file_ground
    logs = [_placed(log, parameters.geometry) for log in logs]
    motion = Replayer(logs, inputs).run(parameters, ground, threads)
    sensor = sensor or Mounting()
    about = {"geometry": vars(parameters.geometry), "replay": {"inputs": inputs, "clock": clock}}
    return [motion.log(k, log, sensor, clock, about) for k, log in enumerate(logs)]


def without_jumps(logs: Sequence[RunLog], geometry: RobotGeometry) -> list[list[RunLog]]:
    """Copies of each log, one per part between lasting jumps in its poses.

    Only poses that identification uses are valid in a copy. Raises LogError for logs that
    identification refuses.
    """
    look = first_look(drives_of(logs)[0], geometry)

    def parts(log: RunLog) -> list[RunLog]:
        drives = [drive for drive in look.drives if drive.name == log.run]
        return [replace(log, valid=np.isin(log.time, drive.time)) for drive in drives]

    return [parts(log) for log in logs]


def _placed(log: RunLog, geometry: RobotGeometry) -> RunLog:
    """The log without outliers and poses after its first lasting jump; unchanged if identification
    refuses it.
    """
    try:
        return without_jumps([log], geometry)[0][0]
    except (LogError, IndexError):
        return log


class Replayer:
    """The inputs in N logs, for replays by different robots on different grounds."""

    def __init__(self, logs: Sequence[RunLog], inputs: Inputs = "encoders") -> None:
        """Prepare logs for replays; `inputs` are those of `replay`."""
        if inputs not in ("encoders", "commands"):
            raise InvalidValueError("inputs", inputs, "encoders or commands")
        self._fastest_command = 0.0  # of the set points, if they are the inputs [rad/s]
        if inputs == "commands":
            self._fastest_command = max(_fastest_command(log) for log in logs)
        self.logs = list(logs)
        self.inputs = inputs
        # (N,) start of each log's run-up [s]
        self.begin = np.array([log.time[0] - RUN_UP for log in logs])
        self._turned = [_turned(log) for log in logs]
        self._fastest = max(float(np.abs(log.omega).max()) for log in logs)

    def run(self, parameters: RobotParameters, ground: Ground, threads: int = 0) -> Replay:
        """Simulate the motion of a robot on a ground.

        During the run-up, and if the inputs are encoders, the sprockets turn as measured.
        Otherwise the drive follows the commands.
        """
        fleet = self._fleet(parameters, ground, threads)
        twist = np.array([first_twist(log, fleet.robot.geometry) for log in self.logs])
        fleet.launch(twist)
        period = fleet.period
        longest = max(log.time[-1] - log.time[0] for log in self.logs)
        periods = round((longest + 2 * RUN_UP) / period)
        edges = self.begin[:, None] + period * np.arange(periods + 1)  # (N, P + 1)
        measured = self._measured(edges, period)
        commanded = self._commands(edges[:, :-1]) if self.inputs == "commands" else None

        poses = np.empty((periods + 1, fleet.size, 3))
        twists = np.empty((periods + 1, fleet.size, 3))
        poses[0] = fleet.pose()
        twists[0] = fleet.twist()
        for k in range(periods):
            if commanded is not None and k * period >= RUN_UP:
                fleet.command(commanded[k])
                fleet.advance(period)
            else:
                fleet.follow(measured[k : k + 1])
            if k + 1 == round(RUN_UP / period):  # a sliding robot has slowed down meanwhile
                fleet.launch(twist)
            poses[k + 1] = fleet.pose()
            twists[k + 1] = fleet.twist()
        return Replay(self.begin, period, poses, twists)

    def _fleet(self, parameters: RobotParameters, ground: Ground, threads: int) -> Fleet:
        """One robot per log, with motors that follow any measured speed if the inputs are
        encoders.
        """
        robot = compiled(parameters)
        fastest = self._fastest * robot.geometry.sprocket_radius
        if not fastest < MAX_SPEED:
            raise LogError(
                f"belts as fast as {fastest:.3g} m/s: replayed are speeds below {MAX_SPEED:g} m/s"
            )
        drive = parameters.drive
        if self.inputs == "encoders":
            drive = tireless(max(Drive.top_speed, _MARGIN * fastest))
        elif drive is None:  # as fast as it is told to be
            asked = self._fastest_command * robot.geometry.sprocket_radius
            drive = tireless(max(TOP_SPEED, _MARGIN * asked))
        start = np.zeros((len(self.logs), 3))
        return Fleet(robot, start, ground, parameters.radius_error, drive, threads)

    def _measured(self, edges: Array, period: float) -> Array:
        """Mean measured speeds (P, N, 2) in the periods between the times `edges` (N, P + 1)
        [rad/s].
        """
        means = []
        for sides, time in zip(self._turned, edges, strict=True):
            angles = [np.interp(time, known, angle) for known, angle in sides]
            means.append(np.diff(angles).T / period)
        return np.stack(means, axis=1)

    def _commands(self, time: Array) -> Array:
        """Commands (P, N, 2) at times (N, P) [rad/s]."""
        commands = []
        for log, at in zip(self.logs, time, strict=True):
            assert log.command is not None
            row = np.searchsorted(log.time, at + _ROUNDING, side="right") - 1
            commands.append(log.command[np.maximum(row, 0)])
        return np.stack(commands, axis=1)


def _fastest_command(log: RunLog) -> float:
    """The fastest set point of a log [rad/s]; raises LogError if a row has none."""
    if log.command is None or not np.isfinite(log.command).all():
        needed = "needs omega_cmd_l and omega_cmd_r in every row to replay commands"
        raise LogError(f"run {log.run!r}: {needed}")
    return float(np.abs(log.command).max())


def _turned(log: RunLog) -> list[tuple[Array, Array]]:
    """Times and angles of each sprocket, which turns at its first speed before the log and at its
    last after it.
    """
    encoders = encoders_of(log).smooth()
    before = log.time[:1] - 2 * RUN_UP
    after = log.time[-1:] + _BEYOND
    time = np.concatenate([before, encoders.edges, after])
    speeds = np.concatenate([log.omega[:1], encoders.omega, encoders.omega[-1:]])
    turned = np.cumsum(speeds * np.diff(time)[:, None], axis=0)
    return [(time, np.append(0.0, side)) for side in turned.T]


def first_twist(log: RunLog, geometry: RobotGeometry) -> Array:
    """Twist (3,) from the poses in the first 0.3 s, or from the sprockets, assuming no slip, if
    there are too few.

    If the sprockets are at rest during this time, the twist is 0.
    """
    is_first = log.time - log.time[0] <= _FIRST
    if not log.omega[is_first].any():
        return np.zeros(3)
    rows = np.flatnonzero(log.has_heading)
    if len(rows):
        rows = rows[log.time[rows] - log.time[rows[0]] <= _FIRST]
    if len(rows) < 2:
        v, w = body_twist(log.omega[0], 0.0, geometry)
        return np.array([v, 0.0, w])

    # a line through the poses
    time = log.time[rows] - log.time[rows].mean()
    pose = log.pose[rows]
    pose[:, 2] = np.unwrap(pose[:, 2])
    mean, rate = np.polynomial.polynomial.polyfit(time, pose, 1)
    return np.append(se2.rotate(-mean[2], rate[:2]), rate[2])
