"""The log to predict, and its parts, each of which is predicted by fits to the other parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

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

_TIME: Final = np.linspace(0.0, 1.0, 11)
"""Times in the drives that represent steady samples [s]."""


def read_log(config: Config, log: Path, known: RobotGeometry | None) -> Source:
    """Read the drives in a `log`, with the `known` geometry if neither log nor options state
    one.
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
    source = read_log_of(log, reading, known)
    drives: Sequence[RunLog] = source.logs or _windows(source.sampling.samples)
    notes = [*source.notes, *map(str, source.refused)]
    # before drives are cut, so that the bias of a gyro is that of the whole drive
    drives, refused = _with_headings(drives)
    notes += [*map(str, refused)]
    if config.folds:
        if len(drives) < config.folds:
            drives = _cut(drives, config.folds)
        prepared, refused = drives_of(drives)
        usable = {drive.name for drive in prepared}
        drives = [log for log in drives if log.run in usable]
        notes += [*map(str, refused)]
    checked = [with_usable_gyro(log) for log in drives]
    drives = [log for log, _ in checked]
    notes += [note for _, note in checked if note]
    return replace(source, logs=tuple(drives), notes=tuple(in_few_lines(notes)))


def _cut(drives: Sequence[RunLog], count: int) -> list[RunLog]:
    """The drives, each cut into `count` parts of equal duration."""
    cut = []
    for log in drives:
        duration = log.time[-1] - log.time[0]
        cut += log.cut(duration / count)
    return cut


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
    ahead = samples.twist[:, 0]
    left = np.zeros(len(samples))
    if samples.lateral is not None:
        left = np.nan_to_num(samples.lateral)
    turn = samples.twist[:, 1]
    twists = np.column_stack([ahead, left, turn])
    poses = se2.exp(_TIME[:, None, None] * twists)  # (T, n, 3)

    logs = []
    for k, name in enumerate(samples.run):
        omega = np.tile(samples.omega[k], (len(_TIME), 1))
        logs.append(RunLog(name, _TIME, omega, poses[:, k]))
    return logs


def parts(drives: Sequence[RunLog], count: int, name: str) -> np.ndarray:
    """Part numbers (n,) for drives: consecutive parts of about equal size; drives with the same
    command share a part.

    Raises LogError, with the `name` of the log, if it has too few different commands.
    """
    keys = [_command_key(log) for log in drives]
    different = list(dict.fromkeys(keys))
    if len(different) < count:
        commands = counted(len(different), "different command")
        raise LogError(f"{name}: has {commands}, too few for folds = {count}")
    part_of = {key: rank * count // len(different) for rank, key in enumerate(different)}
    return np.array([part_of[key] for key in keys])


def _command_key(log: RunLog) -> str | tuple[float, ...]:
    """A key that drives with the same command share; a drive without commands has its own."""
    if log.command is None:
        return log.run
    return tuple(log.command.mean(axis=0).round(3))
