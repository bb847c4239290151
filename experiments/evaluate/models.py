"""Models that predict a log from its encoders: odometry by slip laws, and simulated robots."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from experiments.common.manifest import relative
from experiments.evaluate.config import Config
from experiments.evaluate.log import Log
from sim.calibration.calibration import Calibration, calibrate
from sim.calibration.candidate import Candidate
from sim.calibration.targets import Drives, SteadyRows
from sim.ground.named import load_ground
from sim.log_replay import Inputs, Replayer
from sim.robot.named import load_parameters
from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.drive_law import REFERENCE, DriveFit, fit_drives
from trackslip.identification.drives import drives_of
from trackslip.identification.fitted import fit_law
from trackslip.identification.plausibility import least_squares_gains
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import Array, RobotGeometry, body_twist
from trackslip.logs.runlog import RunLog
from trackslip.odometry.evaluation import estimated_trajectory, trajectory_of
from trackslip.odometry.identified import LawInUse, identified_law, no_slip
from trackslip.odometry.slip_odometry import SlipOdometry
from trackslip.odometry.trajectory_errors import Trajectory
from trackslip.odometry.uncertainty import Gyro
from trackslip.se2 import Mounting
from trackslip.slip.families import FAMILIES, drive_laws
from trackslip.slip.law_file import NO_SLIP

TODAY, GAINS, ROBOT, CALIBRATED = "today", "two_gains", "robot", "calibrated"
"""Names of models that aren't laws."""
FIRST = 1.0
"""Shortest time ahead; steady driving is compared after it [s]."""
_DRIVE_LAWS = (REFERENCE, "turn_loss", "turn_loss_sides", "centrifugal")
_STEADY_LAWS = ("icr", "turn_loss_sides", "icr_sides")
"""Laws that folds fit by default; on the shipped logs, others were never best."""
_EXTRAS = ("sensor_x", "sensor_y", "sensor_yaw", "drift", "clock_offset", "lag")

Spec = tuple[Path | None, str]
"""A file with laws and the name of one, "" for its best; without a file, none or the name of a law to fit."""
Robots = Mapping[str, Sequence[Candidate]]
"""Robots by their labels, one for each part of the log."""


@dataclass(frozen=True)
class Model:
    """Predicts how the sensor of the poses moves."""

    label: str
    """In tables and files: its name, with its file where others have the same name."""
    name: str
    """The law's, or one of TODAY, GAINS, ROBOT and CALIBRATED."""
    sensor: Mounting
    clock_offset: float
    """Encoder clock minus pose clock [s]."""

    def trajectories(self, log: Log) -> list[Trajectory]:
        """Measured and predicted poses of all drives or samples of a log."""
        raise NotImplementedError


@dataclass(frozen=True)
class LawModel(Model):
    """Odometry by a slip law."""

    law: LawInUse
    lag: float = 0.0
    """Time constant with which the motion follows the belts [s]."""

    @property
    def odometry(self) -> SlipOdometry:
        """Odometry without the errors of the law, which take longer."""
        law = self.law
        return SlipOdometry(law.law, law.geometry, law.noise, drift=law.drift, gyro=law.gyro)

    def trajectories(self, log: Log) -> list[Trajectory]:
        """See Model."""
        if log.samples is not None:
            return _steady(log.samples, self.law.law.twist(log.samples.omega, log.geometry))
        logs = [replace(one, omega=_lagging(one, self.lag)) if self.lag > 0 else one for one in log.logs]
        return [trajectory_of(one, self.odometry, self.sensor, self.clock_offset) for one in logs]


@dataclass(frozen=True)
class RobotModel(Model):
    """A simulated robot that drives as encoders or commands say."""

    candidate: Candidate
    inputs: Inputs
    threads: int

    def trajectories(self, log: Log) -> list[Trajectory]:
        """See Model."""
        if log.samples is not None:
            rows = SteadyRows(log.samples, log.geometry, threads=self.threads)
            return _steady(log.samples, rows.predicted(self.candidate)[:2].T)
        motion = Replayer(log.driven or log.logs, self.inputs).run(
            self.candidate.robot, self.candidate.ground, self.threads
        )
        places = [partial(motion.sensor_at, k, self.sensor) for k in range(len(log.logs))]
        pairs = zip(log.logs, places, strict=True)
        return [estimated_trajectory(one, place, log.geometry, self.clock_offset) for one, place in pairs]


def _lagging(log: RunLog, lag: float) -> Array:
    """Sprocket speeds (T, 2), means since the row before, that follow those of a log with a lag [s]."""
    omega, state = log.omega.copy(), log.omega[1]
    for k, step in enumerate(np.diff(log.time), start=1):
        behind, kept = state - log.omega[k], np.exp(-step / lag)
        omega[k] = log.omega[k] + behind * (1 - kept) * lag / step
        state = log.omega[k] + behind * kept
    return omega


def _steady(samples: SlipSamples, twist: Array) -> list[Trajectory]:
    """Motion within FIRST of steady driving, measured and by predicted twists (n, 2); a trajectory a sample."""
    (v, w), time = np.moveaxis(np.stack([samples.twist, twist]), -1, 0), np.array([0.0, FIRST])
    chord, turn = v * FIRST * np.sinc(w * FIRST / (2 * np.pi)), w * FIRST
    ends = np.stack([chord * np.cos(turn / 2), chord * np.sin(turn / 2), turn], axis=-1)  # (2, n, 3)
    poses = np.stack([np.zeros_like(ends), ends], axis=2)
    rows = zip(samples.run, *poses, strict=True)
    return [Trajectory(run, time, np.zeros(2), seen, expected, seen[:, 2]) for run, seen, expected in rows]


def law_specs(config: Config) -> list[Spec]:
    """The laws that the options name; raises InvalidValueError for others."""
    specs: list[Spec] = []
    for text in config.law or (() if config.folds else (NO_SLIP,)):
        file, _, name = text.rpartition(":")
        if text == NO_SLIP or (config.folds and text in FAMILIES):
            specs.append((None, text))
        elif os.path.exists(text):  # unlike Path.exists, also False for names that are too long
            specs.append((Path(text), ""))
        elif file and os.path.exists(file):
            specs.append((Path(file), name))
        else:
            fitted = ", or the name of a law that --folds fits"
            raise InvalidValueError("law", text, f"{NO_SLIP}, a folder or file with laws, either with :NAME{fitted}")
    return specs


def known_geometry(config: Config, specs: Sequence[Spec]) -> RobotGeometry | None:
    """The size of the robot that the laws were identified for, else of the simulated one."""
    laws = [identified_law(file, name or None) for file, name in specs if file is not None]
    if laws:
        return laws[0].geometry
    return load_parameters(config.robot[0])[0].geometry if config.robot else None


def models_of(config: Config, specs: Sequence[Spec], log: Log, part: int, robots: Robots) -> list[Model]:
    """The models that predict a part of the log: today's odometry and two gains with folds, laws, robots."""
    sensor, clock = Mounting(*(config.sensor or (0.0, 0.0, 0.0))), config.clock_offset or 0.0
    others, models = log.take(log.part != part), list[Model]()
    if config.folds:
        baselines = {TODAY: no_slip(log.geometry), GAINS: _gains(others)}
        models = [LawModel(name, name, sensor, clock, law) for name, law in baselines.items()]
        specs = specs or [(None, name) for name in (_DRIVE_LAWS if log.samples is None else _STEADY_LAWS)]
    laws = _laws(config, specs, others, any(one.gyro is not None for one in log.logs) and not config.folds)
    models += laws
    for label, candidates in robots.items():
        one, name = candidates[part], CALIBRATED if label == CALIBRATED else ROBOT
        if not config.folds and config.clock_offset is None:
            one = replace(one, clock=laws[0].clock_offset)
        models.append(RobotModel(label, name, one.sensor, one.clock, one, config.inputs, config.threads))
    return models


def robots_of(config: Config, log: Log) -> tuple[Robots, Calibration | None]:
    """The robots that the options state for each part, and the fit of the first one's free parameters.

    Poses are stamped late, and so the clock is always fitted to the other parts, unless it is given.
    """
    robots, fit = dict[str, Sequence[Candidate]](), None
    for k, source in enumerate(config.robot):
        robot, ground = load_parameters(source)
        ground = config.ground.changed(load_ground(config.ground.source) if config.ground.source else ground)
        sensor = Mounting(*(config.sensor or (0.0, 0.0, 0.0)))
        base = Candidate(robot, ground, sensor, config.clock_offset or 0.0)
        label = f"{ROBOT}_{k + 1}" if k else ROBOT
        clock = ("clock",) if config.folds and config.clock_offset is None and log.logs else ()
        robots[label] = _calibrated(config, log, base, clock).folds if clock else [base] * log.parts
        if k == 0 and config.free:
            fit = _calibrated(config, log, base, tuple(dict.fromkeys((*config.free, *clock))))
            robots[CALIBRATED] = fit.folds
    return robots, fit


def _calibrated(config: Config, log: Log, base: Candidate, free: Sequence[str]) -> Calibration:
    """A robot fitted to the log, and to all but each part."""
    if log.samples is None:
        drives = Drives(log.logs, log.geometry, config.inputs, config.threads)
        return calibrate(drives, base, free, log.part[drives.log])
    rows = SteadyRows(log.samples, log.geometry, threads=config.threads)
    return calibrate(rows, base, free, log.part[rows.layout.cluster])


def _laws(config: Config, specs: Sequence[Spec], others: Log, gyro: bool) -> list[LawModel]:
    """Laws from files, and those without a file fitted to the other parts; with a gyro, the first one once more.

    Unless given, sensor and clock are as identified with each law, for laws shift and turn them differently; laws that
    come without have those of the first law that has them.
    """
    geometry, laws = others.geometry, list[tuple[LawInUse, float]]()
    to_fit = [name for file, name in specs if file is None and name != NO_SLIP]
    reference = fit_drives(REFERENCE, others.logs, geometry) if to_fit and others.logs else None
    for file, name in specs:
        if file is not None:
            laws.append((identified_law(file, name or None, geometry), 0.0))
        elif name in to_fit:
            laws.append(_fitted(name, others, reference))
        else:
            laws.append((no_slip(geometry), 0.0))
    known = next((law for law, _ in laws if law.mounting is not None), laws[0][0])
    names, models = [law.name for law, _ in laws], list[LawModel]()
    for (law, lag), (file, _) in zip(laws, specs, strict=True):
        own = known if law.mounting is None else law
        sensor, clock = own.mounting or Mounting(), own.clock_offset or 0.0
        if config.sensor and not config.folds:  # laws that are fitted have their own turning centre and clock
            sensor = Mounting(*config.sensor)
        if config.clock_offset is not None and not config.folds:
            clock = config.clock_offset
        shared = file is not None and names.count(law.name) > 1
        label = f"{relative(str(file))}:{law.name}" if shared else law.name
        models.append(LawModel(label, law.name, sensor, clock, replace(law, gyro=None), lag))
    if gyro:
        first = next((k for k, name in enumerate(names) if name != NO_SLIP), 0)
        law = replace(laws[first][0], gyro=laws[first][0].gyro or Gyro())
        models.append(replace(models[first], label=f"{models[first].label} with gyro", law=law))
    return models


def _fitted(name: str, others: Log, reference: DriveFit | None) -> tuple[LawInUse, float]:
    """A law fitted to other parts of a log, and the lag of the motion behind the belts [s]."""
    geometry = others.geometry
    if others.samples is not None:
        return LawInUse(name, fit_law(name, others.samples, geometry, bootstraps=0, vague=True).law, geometry), 0.0
    if name not in drive_laws():
        raise InvalidValueError("law", name, f"for drives, one of {', '.join(drive_laws())}")
    fit = fit_drives(name, others.logs, geometry, reference=reference)
    x, y, yaw, drift, clock, lag = (fit.extras[key] for key in _EXTRAS)
    return LawInUse(name, fit.law, geometry, drift=drift, mounting=Mounting(x, y, yaw), clock_offset=clock), lag


def _gains(others: Log) -> LawInUse:
    """Factors on speed and yaw rate by least squares, as the law (1 + ε) and (1 + ε) b / (b + D)."""
    geometry = others.geometry
    if others.samples is not None:
        plain = body_twist(others.samples.omega, 0.0, geometry)
        speed, turn = np.sum(plain * others.samples.twist, axis=0) / np.sum(plain**2, axis=0)
    else:
        speed, turn = least_squares_gains(drives_of(others.logs)[0], geometry)
    if not (np.isfinite(speed) and turn > 0):
        raise LogError(f"{others.name}: its other parts don't drive and turn enough to fit two gains")
    values = {"offset": geometry.half_gauge * (speed / turn - 1), "radius_error": speed - 1}
    return LawInUse(GAINS, FAMILIES[REFERENCE].build(values, geometry), geometry)
