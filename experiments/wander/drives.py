"""Teleoperated drives as the options describe them: commands, motion, and the logs of encoders and poses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from experiments.common.lookup import REACH
from experiments.common.plain_json import plain
from experiments.simulate.drives import driven_by_law, driven_in_mujoco
from experiments.simulate.world import World
from experiments.wander.config import Config
from sim.loop import Progress
from sim.run_recorder import Description
from sim.scanner.scanner import LaserScanner
from sim.seeds import generator
from sim.wander.commands import Driver, track_commands
from sim.wander.motion import LASTING, WHITE, LawMotion, Motion, SlipVariation
from sim.wander.pose_source import plate_scans
from trackslip import se2
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.slip.icr import ConstantIcr

SLIPS: Mapping[str, SlipVariation] = {"white": WHITE, "lasting": LASTING, "none": SlipVariation()}
"""Slip that varies, by name."""
_POSE_MESSAGES = {"mocap": "PoseStamped", "odometry": "Odometry"}
_AT_REST = 1e-3  # mean speed of the tracks below which a robot stands [m/s]
_IN_FRONT = 3.0  # of the scanner: most drives of a minute stay in its view from there [m]
_ON_TIME = 1e-6  # of a period: difference of a reading's time from a multiple of it, by rounding


def wander(config: Config, world: World, progress: Progress = lambda seconds: None) -> list[RunLog]:
    """Drive all drives, at once in MuJoCo; `progress` is called with the seconds simulated of all together.

    Raises:
        RunFailedError: when a robot tips over; its `logs` contain what was recorded until then.
    """
    geometry, rate, count = world.robot.geometry, config.encoder_rate, config.drives
    names = [f"{config.driving} {k + 1}" for k in range(count)]
    driver = Driver(config.max_speed, config.acceleration, REACH * geometry.half_gauge)
    commands = [(config.driving, config.duration, rate, driver, _random(config, name, "commands")) for name in names]
    omega = [track_commands(*one) / geometry.sprocket_radius for one in commands]
    source, start = config.source.poses(), _start(config, world)
    metadata = {"driving": config.driving, "source": plain(source), "motion": config.motion}
    if config.motion == "law":
        by, counts = config.law, world.drive.encoder_counts
        icr = ConstantIcr(by.offset, geometry.half_gauge, by.radius_error)
        law = LawMotion(icr, geometry, SLIPS[by.slip], by.turning_centre, by.drift, by.lag)
        metadata |= {"law": plain(by), "seed": config.seed}
        drives = [
            driven_by_law(name, law, speeds, rate, _random(config, name, "motion"), start, counts, metadata)
            for name, speeds in zip(names, omega, strict=True)
        ]
    else:
        about = world.metadata(config.source.source) | metadata
        if config.source.source != "scanner":  # then there is none in the field
            del about["lrf"], about["scanner"]
        descriptions = [Description(name, about) for name in names]
        fleet = world.fleet(np.tile(start, (count, 1)))
        drives = driven_in_mujoco(fleet, omega, rate, descriptions, lambda seconds: progress(seconds * count))
    return [drive.measured(source, _random(config, drive.log.run, "poses")) for drive in drives]


def bag_contents(config: Config, world: World, log: RunLog) -> dict[str, Any]:
    """Contents of a drive's bag besides its log, as arguments of `write_bag`.

    The encoders' readings are marked, and the poses come as messages of the kind that such a source publishes. With the
    scanner as their source, there are scans by the poses' clock.
    """
    source, counted = config.source.poses(), log.time * config.encoder_rate
    noise = np.array([source.position_noise, source.position_noise, source.heading_noise])
    contents = {
        "readings": np.abs(counted - np.rint(counted)) < _ON_TIME,
        "poses": _POSE_MESSAGES.get(config.source.source, "PoseWithCovarianceStamped"),
        "covariance": np.diag(noise**2),
    }
    if config.source.source == "scanner":
        scanner, robot, motion = LaserScanner(rate=source.rate), world.robot, Motion(log.time, true_pose(log))
        time, scan = plate_scans(scanner, robot.lrf_mount, robot.plate, motion, _random(config, log.run, "scans"))
        contents["scans"] = time + source.delay, scan
    return contents


def true_pose(log: RunLog) -> Array:
    """True poses (T, 3) of a simulated drive."""
    assert log.truth is not None, "of a simulated drive"
    return log.truth.pose


def _start(config: Config, world: World) -> Array:
    """Start (3,) of drives: the origin, or a pose in front of the scanner if it is the source of the poses."""
    if config.source.source != "scanner":
        return np.zeros(3)
    return np.array([*se2.to_world(world.robot.lrf_mount, [_IN_FRONT, 0.0]), 0.0])


def _random(config: Config, name: str, what: str) -> np.random.Generator:
    """Random numbers for a part of a drive, the same however many drives there are."""
    return generator(config.seed, f"wander {name} {what}")


def drive_contents(log: RunLog) -> dict[str, Any]:
    """The true motion of a simulated drive, and what was measured of it: the summary's entry."""
    step = np.diff(true_pose(log), axis=0)
    duration, turn = np.diff(log.time), step[:, 2]
    way = np.hypot(step[:, 0], step[:, 1])
    resting = (way + np.abs(turn)) < _AT_REST * duration
    return {
        "run": log.run,
        "readings": len(log.time),  # of the encoders
        "poses": int(log.is_valid.sum()),
        "way": float(way.sum()),  # [m]
        "turned_left": float(turn[turn > 0].sum()),  # [rad]
        "turned_right": float(-turn[turn < 0].sum()),  # [rad]
        "standing": float(duration[resting].sum() / duration.sum()),  # share of the time at rest [-]
    }
