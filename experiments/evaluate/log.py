"""The log to predict, and its parts, each of which is predicted by fits to the other parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from experiments.calibrate.calibration import read_log_of
from experiments.common.log_options import size_in_bytes
from experiments.evaluate.config import Config
from trackslip import se2
from trackslip.drives.conditioning import drives_of
from trackslip.drives.gyro import with_headings_by_gyro, with_usable_gyro
from trackslip.errors import LogError, counted
from trackslip.identification.samples import SlipSamples
from trackslip.identification.source import ReadOptions, Source
from trackslip.kinematics import RobotGeometry
from trackslip.logs.runlog import Refused, RunLog, in_few_lines, none_usable

_TIME = np.linspace(0.0, 1.0, 11)
"""Times in the drives that represent steady samples [s]."""


def read_log(config: Config, known: RobotGeometry | None) -> Source:
    """Read the drives that the options name, with the `known` geometry if neither log nor options
    state one.
    """
    reading = ReadOptions(
        half_gauge=config.half_gauge,
        sprocket_radius=config.sprocket_radius,
        gear=config.gear,
        bag=config.bag.choice(),
        multiplier=config.multiplier,
        layout=config.table.layout(config.half_gauge, config.sprocket_radius),
        max_memory=size_in_bytes("max_memory", config.max_memory),
    )
    source = read_log_of(config.path, reading, known)
    drives: Sequence[RunLog] = source.logs or _windows(source.sampling.samples)
    notes = [*source.notes, *map(str, source.refused)]
    # before drives are cut, so that the bias of a gyro is that of the whole drive
    drives, refused = _with_headings(drives)
    notes += [*map(str, refused)]
    if config.folds:
        if len(drives) < config.folds:
            drives = [
                part
                for log in drives
                for part in log.cut((log.time[-1] - log.time[0]) / config.folds)
            ]
        prepared, refused = drives_of(drives)
        usable = {drive.name for drive in prepared}
        drives = [log for log in drives if log.run in usable]
        notes += [*map(str, refused)]
    checked = [with_usable_gyro(log) for log in drives]
    drives = [log for log, _ in checked]
    notes += [note for _, note in checked if note]
    return replace(source, logs=tuple(drives), notes=tuple(in_few_lines(notes)))


def _with_headings(drives: Sequence[RunLog]) -> tuple[list[RunLog], list[Refused]]:
    """The drives, with the headings of a gyro where that measures alone, and those in which it
    can't; raises LogError if no drive remains.
    """
    usable = []
    refused = []
    for log in drives:
        try:
            usable.append(with_headings_by_gyro(log))
        except LogError as error:
            refused.append(Refused.of(log.run, error))
    if refused and not usable:
        raise LogError(none_usable(refused))
    return usable, refused


def _windows(samples: SlipSamples) -> list[RunLog]:
    """Steady samples as drives of one second at constant twist, so that errors 1 s ahead are errors
    in the twist.
    """
    left = np.zeros(len(samples)) if samples.lateral is None else np.nan_to_num(samples.lateral)
    motions = _TIME[:, None, None] * np.column_stack(
        [samples.twist[:, 0], left, samples.twist[:, 1]]
    )
    poses = np.moveaxis(se2.exp(motions), 0, 1)
    omegas = np.repeat(samples.omega[:, None], len(_TIME), axis=1)
    return [
        RunLog(name, _TIME, omega, pose)
        for name, omega, pose in zip(samples.run, omegas, poses, strict=True)
    ]


def parts(drives: Sequence[RunLog], count: int, name: str) -> np.ndarray:
    """Part numbers (n,) for drives: consecutive parts of about equal size; drives with the same
    command share a part.

    Raises LogError, with the `name` of the log, if it has too few different commands.
    """
    keys = [
        log.run if log.command is None else tuple(log.command.mean(axis=0).round(3))
        for log in drives
    ]
    rank = {key: k for k, key in enumerate(dict.fromkeys(keys))}
    if len(rank) < count:
        raise LogError(
            f"{name}: has {counted(len(rank), 'different command')}, too few for folds = {count}"
        )
    return np.array([rank[key] * count // len(rank) for key in keys])
