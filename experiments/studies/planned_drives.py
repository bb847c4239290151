"""Planned drives and the paper's runs, driven by a law with random slip or in MuJoCo; predictions of other drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from experiments.driving.world import Specification, World
from experiments.options.world import Simulation
from experiments.storage.plain_json import plain
from sim.drive.drive import Drive
from sim.run_recorder import Description
from sim.runs import Progress, drive_fleet
from sim.seeds import generator
from sim.wander.commands import Driver, track_commands
from sim.wander.log import encoder_log, joined_log, quantised
from sim.wander.motion import LawMotion, Motion, SlipVariation
from sim.wander.pose_source import PoseSource
from trackslip.identification.drive.drives import drive_of
from trackslip.identification.drive.estimate import DriveFit
from trackslip.identification.drive.reckoning import rotated
from trackslip.kinematics import Array, wrap_angle
from trackslip.logs.runlog import RunLog
from trackslip.metrics import rms
from trackslip.planning.information import with_extras
from trackslip.planning.plan import PAPER_DURATION, DrivePlan, paper_runs
from trackslip.planning.strokes import RATE
from trackslip.slip.families import family

OTHER_DRIVES = 4
"""Drives in MuJoCo that the laws predict."""
_OTHER_DURATION = 60.0  # [s]
OTHER_DURATIONS = PAPER_DURATION + _OTHER_DURATION
"""Simulated time of the paper's runs and of the other drives, all at once each [s]."""
_HORIZON = 5.0  # of predictions [s]
_EVERY = 0.5  # between those [s]
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
    readings = np.concatenate([plan.omega[:1], plan.omega[:-1]])  # means since the row before
    return _driven("plan", readings, RATE, _law_motion(plan, truth), plan.start, rng)


def paper_by_law(plan: DrivePlan, truth: Array, rng: np.random.Generator) -> list[Driven]:
    """The paper's runs by the same law."""
    motion = _law_motion(plan, truth)
    rows = round(PAPER_DURATION * _PAPER_RATE) + 1
    return [
        _driven(f"circle {k + 1}", np.tile(omega, (rows, 1)), _PAPER_RATE, motion, np.zeros(3), rng)
        for k, omega in enumerate(_paper_omega(plan))
    ]


@dataclass(frozen=True)
class MujocoDrives:
    """The planned drive, the paper's runs and other drives in MuJoCo."""

    plan: Driven
    paper: list[Driven]
    others: list[Driven]


def driven_in_mujoco(plan: DrivePlan, seed: int, threads: int, progress: Progress) -> MujocoDrives:
    """Drive on the shipped ground, with the shipped robot but for gauge and sprockets.

    `progress` is called with the simulated seconds; raises RunFailedError when a robot tips over.
    """
    geometry, limits = plan.knowledge.geometry, plan.limits
    top_speed = max(limits.max_speed, Drive().top_speed, *(float(np.abs(v).max()) for v in paper_runs(geometry)))
    config = Simulation(seed=seed, threads=threads, drive=Drive(top_speed=top_speed))
    given = Specification.of(config)
    parameters = replace(given.parameters, half_gauge=geometry.half_gauge, sprocket_radius=geometry.sprocket_radius)
    world = World.of(config, replace(given, parameters=parameters))

    def drive(name: str, omega: Sequence[Array]) -> list[Driven]:
        fleet = world.fleet(np.zeros((len(omega), 3)))
        about = [Description(f"{name} {k + 1}", world.metadata("truth")) for k in range(len(omega))]
        logs = drive_fleet(fleet, np.stack(omega, axis=1), RATE, about, progress)
        return [Driven(log, Motion(log.time, log.pose)) for log in logs]

    (planned,) = drive("plan", [plan.omega])
    motion = Motion(planned.motion.time, placed(planned.motion.pose, plan.start))
    circles = [np.tile(omega, (round(PAPER_DURATION * RATE) + 1, 1)) for omega in _paper_omega(plan)]
    driver = Driver(limits.max_speed, limits.acceleration, plan.knowledge.reach)
    others = [
        track_commands("random", _OTHER_DURATION, RATE, driver, generator(seed, f"plan other {k}"))
        / geometry.sprocket_radius
        for k in range(OTHER_DRIVES)
    ]
    return MujocoDrives(
        Driven(replace(planned.log, pose=motion.pose), motion),
        drive("circle", circles) if circles else [],
        drive("other", others),
    )


def placed(pose: Array, start: Array) -> Array:
    """Poses (F, 3) from the origin, as seen from where the robot starts at `start` (3,)."""
    return start + np.column_stack([rotated(start[2], pose[:, :2]), pose[:, 2]])


def _law_motion(plan: DrivePlan, truth: Array) -> LawMotion:
    geometry = plan.knowledge.geometry
    return LawMotion(family(plan.law).law(truth, geometry), geometry, SlipVariation(*plan.knowledge.slip))


def _paper_omega(plan: DrivePlan) -> list[Array]:
    """Sprocket speeds (2,) of the paper's runs [rad/s]."""
    geometry = plan.knowledge.geometry
    return [speeds / geometry.sprocket_radius for speeds in paper_runs(geometry)]


def _driven(name: str, omega: Array, rate: float, motion: LawMotion, start: Array, rng: np.random.Generator) -> Driven:
    moved, twist = motion.drive(omega, rate, rng)
    real = Motion(moved.time, placed(moved.pose, start))
    log = encoder_log(name, rate, omega, real, twist, {"geometry": plain(motion.geometry)})
    return Driven(quantised(log, Drive().encoder_counts), real)


def prediction_errors(fit: DriveFit, others: Sequence[Driven]) -> tuple[float, float]:
    """Root mean square errors of the position [m] and heading [rad] of drives, predicted 5 s ahead by the law alone."""
    values = with_extras(fit.fit.values[: len(fit.values)])
    missed = []
    for other in others:
        drive = drive_of(other.log)
        start = np.arange(0, len(drive.pose) - round(_HORIZON * RATE), round(_EVERY * RATE))
        end = start + round(_HORIZON * RATE)
        missed.append(_moved(fit.fit.model.sensor_path(values, drive), start, end) - _moved(drive.pose, start, end))
    x, y, turn = np.concatenate(missed).T
    return rms(np.hypot(x, y)), rms(wrap_angle(turn))


def _moved(pose: Array, start: np.ndarray, end: np.ndarray) -> Array:
    """Motion (n, 3) between poses, in the frame of the first."""
    way = rotated(-pose[start, 2], pose[end, :2] - pose[start, :2])
    return np.column_stack([way, pose[end, 2] - pose[start, 2]])
