"""The models of an evaluation: those that the options name, fitted to other parts of the log where they say so."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from experiments.common.manifest import relative
from experiments.evaluate.config import Config
from experiments.evaluate.log import Log
from experiments.evaluate.models import CALIBRATED, GAINS, ROBOT, TODAY, LawModel, Model, RobotModel
from sim.calibration.calibration import Calibration, calibrate
from sim.calibration.candidate import Candidate
from sim.calibration.targets import Drives, SteadyRows
from sim.ground.named import load_ground
from sim.robot.named import load_parameters
from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.drive_law import REFERENCE, fit_drives
from trackslip.identification.drives import drives_of
from trackslip.identification.fitted import fit_law
from trackslip.identification.plausibility import least_squares_gains
from trackslip.kinematics import RobotGeometry, body_twist
from trackslip.odometry.identified import LawInUse, identified_law, no_slip
from trackslip.se2 import Mounting
from trackslip.slip.families import FAMILIES, drive_laws
from trackslip.slip.law_file import NO_SLIP

_DRIVE_LAWS = (REFERENCE, "turn_loss", "turn_loss_sides", "centrifugal")
_STEADY_LAWS = ("icr", "turn_loss_sides", "icr_sides")
"""Laws that folds fit by default; on the shipped logs, others were never best."""

Spec = tuple[Path | None, str | None]
"""A file with laws and the name of one, by default its best; without a file, none or the name of a law to fit."""


def law_specs(config: Config) -> list[Spec]:
    """The laws that the options name; raises InvalidValueError for others."""
    specs: list[Spec] = []
    for text in config.law or (() if config.folds else (NO_SLIP,)):
        file, _, name = text.rpartition(":")
        if text == NO_SLIP or (config.folds and text in FAMILIES):
            specs.append((None, text))
        elif os.path.exists(text):  # unlike Path.exists, also False for names that are too long
            specs.append((Path(text), None))
        elif file and os.path.exists(file):
            specs.append((Path(file), name))
        else:
            fitted = ", or the name of a law that --folds fits"
            raise InvalidValueError("law", text, f"{NO_SLIP}, a folder or file with laws, either with :NAME{fitted}")
    return specs


def known_geometry(config: Config, specs: Sequence[Spec]) -> RobotGeometry | None:
    """The size of the robot that the laws were identified for, else of the simulated one."""
    laws = [identified_law(file, name) for file, name in specs if file is not None]
    if laws:
        return laws[0].geometry
    return load_parameters(config.robot[0])[0].geometry if config.robot else None


def models_of(
    config: Config, specs: Sequence[Spec], log: Log, part: int, calibration: Calibration | None
) -> list[Model]:
    """The models that predict a part of the log: today's odometry and two gains with folds, laws, robots."""
    others = log.take(log.part != part)
    sensor, clock = Mounting(*(config.sensor or (0.0, 0.0, 0.0))), config.clock_offset or 0.0
    models: list[Model] = []
    if config.folds:
        baselines = {TODAY: no_slip(log.geometry), GAINS: _gains(others)}
        models = [LawModel(name, name, sensor, clock, law) for name, law in baselines.items()]
        specs = specs or [(None, name) for name in (_DRIVE_LAWS if log.samples is None else _STEADY_LAWS)]
    laws = _laws(config, specs, others)
    late = laws[0].clock_offset if laws and config.clock_offset is None else clock
    models += laws
    for k, base in enumerate(bases(config)):
        label = Path(config.robot[k]).stem if k else ROBOT
        candidates = {label: replace(base, clock=late)}
        if calibration is not None and k == 0:
            candidates[CALIBRATED] = calibration.folds[part]
        for label, one in candidates.items():
            name = label if label in (ROBOT, CALIBRATED) else ROBOT
            models.append(RobotModel(label, name, one.sensor, one.clock, one, config.inputs, config.threads))
    return models


def _laws(config: Config, specs: Sequence[Spec], others: Log) -> list[LawModel]:
    """Laws from files, and those without a file fitted to other parts of the log.

    Unless given, sensor and clock are as identified with each law, for laws shift and turn them differently; laws that
    come without have those of the first law that has them.
    """
    fits = _fits([name for file, name in specs if file is None and name and name != NO_SLIP], others)
    laws, geometry = list[LawModel](), others.geometry
    for file, name in specs:
        if file is None and name in fits:
            laws.append(fits[name])
            continue
        law = no_slip(geometry) if file is None else replace(identified_law(file, name, geometry), gyro=None)
        laws.append(LawModel(law.name, law.name, law.mounting or Mounting(), law.clock_offset or 0.0, law))
    first = next((law for law in laws if law.law.mounting is not None), None)
    names = [law.name for law in laws]
    for k, (file, _) in enumerate(specs):
        known = first if laws[k].law.mounting is None and first else laws[k]
        sensor = Mounting(*config.sensor) if config.sensor else known.sensor
        clock = known.clock_offset if config.clock_offset is None else config.clock_offset
        shared = file is not None and names.count(names[k]) > 1
        label = f"{relative(str(file))}:{names[k]}" if shared else names[k]
        laws[k] = replace(laws[k], label=label, sensor=sensor, clock_offset=clock)
    return laws


def _fits(names: Sequence[str], others: Log) -> dict[str, LawModel]:
    """Laws fitted to other parts of a log."""
    geometry, models = others.geometry, dict[str, LawModel]()
    if others.samples is not None:
        for name in names:
            law = fit_law(name, others.samples, geometry, bootstraps=0, vague=True).law
            models[name] = LawModel(name, name, Mounting(), 0.0, LawInUse(name, law, geometry))
        return models
    reference = fit_drives(REFERENCE, others.logs, geometry) if names else None
    for name in names:
        if name not in drive_laws():
            raise InvalidValueError("law", name, f"for drives, one of {', '.join(drive_laws())}")
        fit = fit_drives(name, others.logs, geometry, reference=reference)
        extras = fit.extras
        sensor = Mounting(*(extras[f"sensor_{axis}"] for axis in ("x", "y", "yaw")))
        law = LawInUse(name, fit.law, geometry, drift=extras["drift"], mounting=sensor)
        models[name] = LawModel(name, name, sensor, extras["clock_offset"], law, extras["lag"])
    return models


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


def bases(config: Config) -> list[Candidate]:
    """The robots that the options state, on their ground."""
    candidates = []
    for source in config.robot:
        robot, ground = load_parameters(source)
        ground = config.ground.changed(load_ground(config.ground.source) if config.ground.source else ground)
        sensor = Mounting(*(config.sensor or (0.0, 0.0, 0.0)))
        candidates.append(Candidate(robot, ground, sensor, config.clock_offset or 0.0))
    return candidates


def calibrated(config: Config, log: Log) -> Calibration | None:
    """The first robot fitted to the log, and to all but each part; None if nothing is to be fitted."""
    if not config.free:
        return None
    target: Drives | SteadyRows
    if log.samples is None:
        target = Drives(log.logs, log.geometry, config.inputs, config.threads)
        part = log.part[target.log]
    else:
        target = SteadyRows(log.samples, log.geometry, threads=config.threads)
        part = log.part[target.layout.cluster]
    return calibrate(target, bases(config)[0], config.free, part)
