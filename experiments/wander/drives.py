"""Teleoperated drives according to the options: commands, motion, and the logs of encoders and
poses.
"""

from typing import Any, Final

import numpy as np

from experiments.common.plain_json import plain
from experiments.simulate.world import World
from experiments.wander.config import Config
from sim.common.seeds import generator
from sim.runs.loop import Progress, open_loop
from sim.runs.run_recorder import Description
from sim.scanner.scanner import LaserScanner
from sim.wander.motion import Driver, Motion, joined_log, track_commands
from sim.wander.pose_sensor import plate_scans
from trackslip import se2
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog

_AT_REST: Final = 1e-3  # mean speed of the tracks below which a robot is at rest [m/s]
# (b + D) / b of the shipped robot on stone, with which the driver respects the tracks' largest
# speed [-]
_REACH: Final = 1.27
# distance of the start from the scanner, in whose view most one-minute drives stay [m]
_IN_FRONT: Final = 3.0
_ON_TIME: Final = 1e-6  # rounding error of a reading's time as a multiple of the period [periods]


def wander(config: Config, world: World, progress: Progress) -> list[RunLog]:
    """Simulate all drives at once; `progress` is called with the simulated seconds, summed over
    drives.

    Raises RunFailedError when a robot tips over; the error's `logs` contain the drives up to then.
    """
    geometry = world.robot.geometry
    rate = config.encoder_rate
    names = [f"{config.driving} {k + 1}" for k in range(config.drives)]
    fastest = config.fastest(world.drive)
    driver = Driver(fastest, config.acceleration, _REACH * geometry.half_gauge)
    omega = []
    for name in names:
        random = _random(config, name, "commands")
        belts = track_commands(config.driving, config.duration, rate, driver, random)
        omega.append(belts / geometry.sprocket_radius)
    source = config.source.poses()
    start = np.zeros(3)
    if config.source.source == "scanner":
        start[:2] = se2.to_world(world.robot.lrf_mount, [_IN_FRONT, 0.0])
    metadata = world.metadata(config.source.source) | {
        "driving": config.driving,
        "source": plain(source),
    }
    if config.source.source != "scanner":  # other sources have no scanner in the field
        del metadata["lrf"], metadata["scanner"]
    logs = open_loop(
        world.fleet(np.tile(start, (len(names), 1))),
        np.stack(omega, axis=1),
        (len(omega[0]) - 1) / rate,
        descriptions=[Description(name, metadata) for name in names],
        progress=lambda seconds: progress(seconds * len(names)),
        period=1 / rate,
    )
    return [_with_poses(config, log) for log in logs]


def _with_poses(config: Config, log: RunLog) -> RunLog:
    """The log of a drive with poses as the source measures them."""
    motion = Motion(log.time, log.pose)
    random = _random(config, log.run, "poses")
    return joined_log(log, *config.source.poses().measure(motion, random))


def bag_contents(config: Config, world: World, log: RunLog) -> dict[str, Any]:
    """Further arguments of `write_bag` for a log: poses as their source publishes them, and the
    scanner's scans.
    """
    source = config.source.poses()
    counted = log.time * config.encoder_rate
    noise = np.array([source.position_noise, source.position_noise, source.heading_noise])
    contents: dict[str, Any] = {
        "readings": np.abs(counted - np.rint(counted)) < _ON_TIME,
        "covariance": np.diag(noise**2),
    }
    if config.source.source == "scanner":
        scanner = LaserScanner(rate=source.rate)
        motion = Motion(log.time, _true_pose(log))
        random = _random(config, log.run, "scans")
        time, scan = plate_scans(scanner, world.robot, motion, random)
        contents["scans"] = (time + source.delay, scan)
    return contents


def drive_contents(log: RunLog) -> dict[str, Any]:
    """A simulated drive as an entry in summary.json: its true motion, and its numbers of
    measurements.
    """
    step = np.diff(_true_pose(log), axis=0)
    duration = np.diff(log.time)
    distance = np.hypot(step[:, 0], step[:, 1])
    turn = step[:, 2]
    to_left = turn[turn > 0]
    to_right = -turn[turn < 0]
    resting = (distance + np.abs(turn)) < _AT_REST * duration
    return {
        "run": log.run,
        "readings": len(log.time),  # number of encoder readings
        "poses": int(log.is_valid.sum()),
        "way": float(distance.sum()),  # [m]
        "turned_left": float(to_left.sum()),  # [rad]
        "turned_right": float(to_right.sum()),  # [rad]
        # share of the time at rest [-]
        "standing": float(duration[resting].sum() / duration.sum()),
    }


def _true_pose(log: RunLog) -> Array:
    assert log.truth is not None, "of a simulated drive"
    return log.truth.pose


def _random(config: Config, name: str, what: str) -> np.random.Generator:
    """Random numbers for `what` in a drive, independent of the number of drives."""
    return generator(config.seed, f"wander {name} {what}")
