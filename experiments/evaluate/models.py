"""Models that predict a log from its encoders: odometry by slip laws, and simulated robots."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from experiments.calibrate.calibration import first_candidate
from experiments.evaluate.config import Config
from sim.calibration.calibration import Calibration, calibrate
from sim.calibration.candidate import Candidate
from sim.calibration.targets import Drives
from sim.robot.named import load_parameters
from sim.runs.log_replay import Replayer
from trackslip.drives.conditioning import drives_of
from trackslip.drives.first_look import Look, first_look
from trackslip.errors import InvalidValueError, did_you_mean
from trackslip.identification.comparison import REFERENCE
from trackslip.identification.drive_comparison import TODAY
from trackslip.identification.law_fit import DriveFit, fit_drives
from trackslip.identification.source import Source
from trackslip.kinematics import RobotGeometry
from trackslip.laws.families import FAMILIES, GAINS, drive_laws
from trackslip.laws.file import NO_SLIP
from trackslip.logs.runlog import RunLog
from trackslip.odometry.evaluation import Trajectory, estimated_trajectory, trajectory_of
from trackslip.odometry.identified import LawInUse, identified_law, no_slip
from trackslip.odometry.uncertainty import Gyro
from trackslip.se2 import Mounting

ROBOT: Final = "robot"
"""Model name of a simulated robot as given."""
CALIBRATED: Final = "calibrated"
"""Model name of a simulated robot as fitted."""
_FITTED: Final = (REFERENCE, "turn_loss", "turn_loss_sides", "centrifugal")
"""Laws that folds fit by default; on the shipped logs, other laws were never best."""


@dataclass(frozen=True)
class Model:
    """A model that predicts the motion of the pose sensor."""

    label: str
    """Label in tables and files: the name, made unique if several models share it."""
    name: str
    """The law's name, or one of TODAY, GAINS, ROBOT and CALIBRATED."""
    sensor: Mounting
    clock_offset: float
    """Encoder clock minus pose clock [s]."""
    trajectories: Callable[[Sequence[RunLog], Sequence[RunLog]], list[Trajectory]]
    """Function of drives, and of the same drives with encoders as read, that returns measured and
    predicted poses.
    """


def _law_model(
    label: str, law: LawInUse, sensor: Mounting, clock: float, gyro: Gyro | None = None
) -> Model:
    """Odometry with a slip law and, if `gyro` is given, with the log's gyroscope."""
    # computing with the law's errors takes longer
    odometry = replace(law, errors=None, gyro=gyro).odometry()

    def trajectories(drives: Sequence[RunLog], _: Sequence[RunLog]) -> list[Trajectory]:
        return [trajectory_of(drive, odometry, sensor, clock) for drive in drives]

    return Model(label, law.name, sensor, clock, trajectories)


def _robot_model(
    label: str, candidate: Candidate, geometry: RobotGeometry, config: Config
) -> Model:
    """A simulated robot that is driven by the log's encoders or commands."""
    sensor = candidate.sensor
    clock = candidate.clock

    def trajectories(drives: Sequence[RunLog], read: Sequence[RunLog]) -> list[Trajectory]:
        replayer = Replayer(read, config.inputs)
        motion = replayer.run(candidate.robot, candidate.ground)
        predicted = []
        for k, drive in enumerate(drives):
            pose_at = partial(motion.sensor_at, k, sensor)
            predicted.append(estimated_trajectory(drive, pose_at, geometry, clock))
        return predicted

    name = CALIBRATED if label == CALIBRATED else ROBOT
    return Model(label, name, sensor, clock, trajectories)


def stored_law(text: str, config: Config, geometry: RobotGeometry | None = None) -> LawInUse | None:
    """The law in a file that --law names; None for `none`, and for laws that are to be fitted with
    folds.
    """
    if text == NO_SLIP or (config.folds and text in drive_laws()):
        return None
    file, _, name = (text, "", "") if os.path.exists(text) else text.rpartition(":")
    if not os.path.exists(file):  # unlike Path.exists, also False for names that are too long
        raise InvalidValueError(
            "law",
            text,
            f"{NO_SLIP}, a folder or file with laws, or with --folds a law of drives"
            f"{did_you_mean(text, (NO_SLIP, *drive_laws()))}",
        )
    return identified_law(file, name or None, geometry)


def known_geometry(config: Config) -> RobotGeometry | None:
    """Geometry of the robot that stored laws belong to, or of the first simulated robot; checks
    every --law.
    """
    laws = [law for text in config.law if (law := stored_law(text, config)) is not None]
    if laws:
        return laws[0].geometry
    return load_parameters(config.robot[0])[0].geometry if config.robot else None


def models_of(
    config: Config,
    source: Source,
    part: np.ndarray,
    k: int,
    robots: Mapping[str, Sequence[Candidate]],
) -> list[Model]:
    """Models that predict the drives labelled k in `part` (n,): laws, robots and, with folds, no
    slip and two gains.
    """
    sensor = Mounting(*config.sensor) if config.sensor else Mounting()
    clock = config.clock_offset or 0.0
    others = [drive for drive, label in zip(source.logs, part, strict=True) if label != k]
    geometry = source.geometry
    models: list[Model] = []
    look = None
    if config.folds:
        usable, _ = drives_of(others)
        look = first_look(usable, geometry, sensor)
        today = replace(no_slip(geometry), name=TODAY)
        gains = _gains(look, geometry)
        models = [_law_model(law.name, law, sensor, clock) for law in (today, gains)]
    has_gyro = any(drive.gyro is not None for drive in source.logs)
    laws = _law_models(config, look, geometry, has_gyro)
    models += laws
    for label, candidates in robots.items():
        robot = candidates[k]
        if not config.folds and config.clock_offset is None:
            robot = replace(robot, clock=laws[0].clock_offset)
        models.append(_robot_model(label, robot, geometry, config))
    return models


def _law_models(
    config: Config, look: Look | None, geometry: RobotGeometry, gyro: bool
) -> list[Model]:
    """Models of the laws in --law, or of default laws; without folds, also of the first law with a
    gyroscope if `gyro`.

    Unless given, sensor and clock offset are those identified with each law, because they differ
    between laws. Laws without a sensor and clock offset get those of the first law that has them.
    """
    texts = config.law or (_FITTED if config.folds else (NO_SLIP,))
    fitted = config.folds and any(text in drive_laws() for text in texts)
    reference = None
    if look is not None and fitted:
        start = look.gains.start(geometry, look.clock)
        reference = fit_drives(REFERENCE, look.drives, geometry, start=start)
    laws = [_law(text, config, geometry, reference) for text in texts]
    known = next((law for law in laws if law.mounting is not None), laws[0])
    names = [law.name for law in laws]
    models: list[Model] = []
    for text, law in zip(texts, laws, strict=True):
        own = known if law.mounting is None else law
        sensor = own.mounting or Mounting()
        clock = own.clock_offset or 0.0
        if not config.folds:  # laws that are fitted have their own turning centre and clock
            sensor = Mounting(*config.sensor) if config.sensor else sensor
            clock = clock if config.clock_offset is None else config.clock_offset
        label = text if names.count(law.name) > 1 else law.name
        models.append(_law_model(label, law, sensor, clock))
    if gyro and not config.folds:
        first = next((k for k, name in enumerate(names) if name != NO_SLIP), 0)
        model = models[first]
        law = laws[first]
        label = f"{model.label} with gyro"
        models.append(_law_model(label, law, model.sensor, model.clock_offset, law.gyro or Gyro()))
    return models


def _law(
    text: str, config: Config, geometry: RobotGeometry, reference: DriveFit | None
) -> LawInUse:
    """The law `text`: from a file, no slip, or fitted to the log's other parts, starting from the
    `reference` fit.
    """
    law = stored_law(text, config, geometry)
    if law is not None or text == NO_SLIP:
        return law or no_slip(geometry)
    assert reference is not None
    fit = fit_drives(text, reference.fit.drives.drives, geometry, reference=reference)
    extras = fit.extras
    sensor = Mounting(extras["sensor_x"], extras["sensor_y"], extras["sensor_yaw"])
    clock = extras["clock_offset"] - extras["lag"]
    drift = extras["drift"]
    return LawInUse(text, fit.law, geometry, drift=drift, mounting=sensor, clock_offset=clock)


def _gains(look: Look, geometry: RobotGeometry) -> LawInUse:
    """The law with two gains: (1 + ε) on speed, and (1 + ε) b / (b + D) on yaw rate."""
    law = FAMILIES[REFERENCE].build(look.gains.law(geometry), geometry)
    return LawInUse(GAINS, law, geometry)


def notes_on_motors(config: Config) -> list[str]:
    """A line for each robot without motors that commands drive; measured speeds need no motors."""
    if config.inputs == "encoders":
        return []
    return [
        f"{robot} has no motors: its torque is unlimited, and it follows commands of any speed"
        for robot in config.robot
        if load_parameters(robot)[0].drive is None
    ]


def robots_of(
    config: Config, source: Source, part: np.ndarray
) -> tuple[dict[str, Sequence[Candidate]], Calibration | None]:
    """The robots by label, one for each part of a log, and the fit of the first robot's free
    parameters.

    As poses are stamped late, folds always fit the clock offset to the log's other parts, unless it
    is given.
    """
    robots: dict[str, Sequence[Candidate]] = {}
    fit = None
    clock = ("clock",) if config.folds and config.clock_offset is None else ()
    for k, robot in enumerate(config.robot):
        base = first_candidate(robot, config.ground, config.sensor, config.clock_offset)
        label = f"{ROBOT}_{k + 1}" if k else ROBOT
        robots[label] = [base] * (config.folds or 1)
        if not config.folds:
            continue
        target = Drives(source.logs, source.geometry, config.inputs)
        if clock:
            robots[label] = calibrate(target, base, clock, part[target.log]).folds
        if k == 0 and config.free:
            free = tuple(dict.fromkeys((*config.free, *clock)))
            fit = calibrate(target, base, free, part[target.log])
            robots[CALIBRATED] = fit.folds
    return robots, fit
