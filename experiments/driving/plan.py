"""Planned drives driven: by a law with random slip, or in MuJoCo, beside the paper's runs; and what is measured."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from experiments.driving.world import Specification, World
from experiments.options.world import Simulation
from experiments.storage.plain_json import plain
from sim.drive.drive import Drive
from sim.robot.parameters import RobotParameters
from sim.run_recorder import Description
from sim.runs import Progress
from sim.seeds import generator
from sim.wander.commands import Driver, track_commands
from sim.wander.fleet_motion import drive_fleet
from sim.wander.law_motion import LawMotion, SlipVariation
from sim.wander.log import encoder_log, joined_log, quantised
from sim.wander.motion import Motion
from sim.wander.pose_source import PoseSource
from trackslip.identification.drive.reckoning import rotated
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.planning.plan import PAPER_DURATION, DrivePlan, paper_runs
from trackslip.planning.strokes import RATE
from trackslip.slip.families import family

OTHER_DRIVES = 4
"""Drives in MuJoCo that the laws predict."""
_OTHER_DURATION = 60.0  # [s]
_PAPER_RATE = 10.0  # of the encoders in the paper's runs, whose speeds are constant [Hz]


@dataclass(frozen=True)
class Driven:
    """A log of encoders, and the true motion in the area."""

    log: RunLog
    motion: Motion

    def measured(self, source: PoseSource, rng: np.random.Generator) -> RunLog:
        """The log as a source of poses sees it."""
        return joined_log(self.log, *source.measure(self.motion, rng))


def driven_by_law(plan: DrivePlan, truth: Array, rng: np.random.Generator) -> Driven:
    """The planned drive by the law with the parameters `truth` (q,), with white slip."""
    motion = _law_motion(plan, truth)
    return _driven("plan", _readings(plan.omega), RATE, motion, plan.start, rng)


def paper_by_law(plan: DrivePlan, truth: Array, rng: np.random.Generator) -> list[Driven]:
    """The paper's runs by the same law."""
    motion, radius = _law_motion(plan, truth), plan.knowledge.geometry.sprocket_radius
    rows = round(PAPER_DURATION * _PAPER_RATE) + 1
    return [
        _driven(f"circle {k + 1}", np.tile(speeds / radius, (rows, 1)), _PAPER_RATE, motion, np.zeros(3), rng)
        for k, speeds in enumerate(paper_runs(plan.knowledge.geometry))
    ]


@dataclass(frozen=True)
class SimulatedDrives:
    """The planned drive, the paper's runs and other drives in MuJoCo."""

    plan: Driven
    paper: list[Driven]
    others: list[Driven]


def driven_in_mujoco(plan: DrivePlan, seed: int, threads: int, progress: Progress) -> SimulatedDrives:
    """Drive on the shipped ground, with the shipped robot but for gauge and sprockets.

    `progress` is called with the simulated seconds; raises RunFailedError when a robot tips over.
    """
    geometry, limits = plan.knowledge.geometry, plan.limits
    top_speed = max(limits.max_speed, Drive().top_speed, *(float(np.abs(v).max()) for v in paper_runs(geometry)))
    config = Simulation(seed=seed, threads=threads, drive=Drive(top_speed=top_speed))
    given = Specification.of(config)
    parameters: RobotParameters = replace(
        given.parameters, half_gauge=geometry.half_gauge, sprocket_radius=geometry.sprocket_radius
    )
    world = World.of(config, replace(given, parameters=parameters))
    driver = Driver(limits.max_speed, limits.acceleration, plan.knowledge.reach)
    others = [
        track_commands("random", _OTHER_DURATION, RATE, driver, generator(seed, f"plan other {k}"))
        for k in range(OTHER_DRIVES)
    ]
    circles = [np.tile(speeds, (round(PAPER_DURATION * RATE) + 1, 1)) for speeds in paper_runs(geometry)]

    def drive(name: str, speeds: list[Array]) -> list[Driven]:
        fleet = world.fleet(np.zeros((len(speeds), 3)))
        about = [Description(f"{name} {k + 1}", world.metadata("truth")) for k in range(len(speeds))]
        omega = np.stack(speeds, axis=1) / geometry.sprocket_radius
        return [Driven(log, Motion(log.time, log.pose)) for log in drive_fleet(fleet, omega, RATE, about, progress)]

    planned = drive("plan", [plan.speeds])[0]
    motion = Motion(planned.motion.time, placed(planned.motion.pose, plan.start))
    log = replace(planned.log, pose=motion.pose)
    return SimulatedDrives(Driven(log, motion), drive("circle", circles) if circles else [], drive("other", others))


def placed(pose: Array, start: Array) -> Array:
    """Poses (F, 3) from the origin, as seen from where the robot starts at `start` (3,)."""
    return start + np.column_stack([rotated(start[2], pose[:, :2]), pose[:, 2]])


def _law_motion(plan: DrivePlan, truth: Array) -> LawMotion:
    geometry = plan.knowledge.geometry
    return LawMotion(family(plan.law).law(truth, geometry), geometry, SlipVariation(*plan.knowledge.slip))


def _readings(omega: Array) -> Array:
    """What encoders read (T, 2): means since the row before, from commands (T, 2) that hold until the next row."""
    return np.concatenate([omega[:1], omega[:-1]])


def _driven(name: str, omega: Array, rate: float, motion: LawMotion, start: Array, rng: np.random.Generator) -> Driven:
    moved, twist = motion.drive(omega, rate, rng)
    real = Motion(moved.time, placed(moved.pose, start))
    log = encoder_log(name, rate, omega, real, twist, {"geometry": plain(motion.geometry)})
    return Driven(quantised(log, Drive().encoder_counts), real)
