"""The log that is predicted: drives or steady samples, in parts that are predicted by fits to the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from experiments.common.run_table import chosen
from experiments.evaluate.config import Config
from trackslip.doubts import in_few_lines
from trackslip.errors import InvalidValueError, LogError, counted
from trackslip.identification.drives import counts_few_ticks, drives_of, interval_means
from trackslip.identification.samples import SlipSamples
from trackslip.identification.source import ReadOptions, Source, read_source
from trackslip.kinematics import RobotGeometry
from trackslip.logs.runlog import RunLog


@dataclass(frozen=True)
class Log:
    """Drives, or steady samples if there are no drives."""

    name: str
    geometry: RobotGeometry
    logs: Sequence[RunLog]
    samples: SlipSamples | None
    part: np.ndarray
    """(n,) part of each drive or sample, from 0."""
    notes: Sequence[str]
    """What was left out, and why."""
    taken: Sequence[str]
    """Topics taken from a bag."""
    driven: Sequence[RunLog] = ()
    """The same drives as they are replayed, if encoders of `logs` go on at their ends."""

    @property
    def parts(self) -> int:
        """Number of parts."""
        return int(self.part.max()) + 1

    def take(self, rows: np.ndarray) -> Log:
        """The drives or samples `rows` (n,) bool."""
        logs = [log for log, wanted in zip(self.logs, rows, strict=False) if wanted]
        samples = None if self.samples is None else self.samples.take(rows)
        return replace(self, logs=logs, samples=samples, part=self.part[rows])


def read_log(config: Config, known: RobotGeometry | None) -> Log:
    """The log that the options name, of a robot of the `known` size if neither log nor options state one."""
    source = _source(config, known)
    logs, samples = list(source.logs), None
    notes: list[str] = [*source.notes, *(one.doubt for one in source.refused)]
    keys: list[Any] = [log.run for log in logs]
    if not logs:
        samples = source.sampling.samples
        notes, keys = [one.doubt for one in source.sampling.refused], list(samples.run)
    elif config.folds:
        if len(logs) < config.folds:
            logs = [part for log in logs for part in log.cut((log.time[-1] - log.time[0]) / config.folds)]
        prepared, refused = drives_of(logs)
        usable = {drive.name for drive in prepared}
        logs = [_read_once(log) for log in logs if log.run in usable]
        notes += [one.doubt for one in refused]
        keys = [log.run if log.command is None else tuple(log.command.mean(axis=0).round(3)) for log in logs]
    part = parts(keys, config.folds or 1, source.name)
    few = in_few_lines(notes, len(keys) + len(notes))
    return Log(source.name, source.geometry, logs, samples, part, few, source.taken)


def _source(config: Config, known: RobotGeometry | None) -> Source:
    reading = ReadOptions(config.half_gauge, config.sprocket_radius, config.gear, bag=config.bag.choice())
    select = partial(chosen, where=config.where) if config.where else None
    try:
        return read_source(config.path, reading, select)
    except InvalidValueError as error:
        if known is None or error.field not in asdict(known) or error.value is not None:
            raise
        b, r = config.half_gauge or known.half_gauge, config.sprocket_radius or known.sprocket_radius
        return read_source(config.path, replace(reading, half_gauge=b, sprocket_radius=r), select)


def _read_once(log: RunLog) -> RunLog:
    """A log in which readings of encoders that were logged several times count once, as in fits and replays."""
    means = interval_means(log.time, log.omega, counts_few_ticks(log.time, log.omega))
    return replace(log, omega=np.concatenate([log.omega[:1], means]))


def parts(keys: Sequence[Any], count: int, name: str) -> np.ndarray:
    """Parts (n,) of about equal size in the order of the log; what has the same key, a command, is in the same part.

    Raises LogError, with the `name` of the log, if it has too few different keys.
    """
    rank = {key: k for k, key in enumerate(dict.fromkeys(keys))}
    if len(rank) < count:
        raise LogError(f"{name}: has {counted(len(rank), 'different command')}, too few for folds = {count}")
    return np.array([rank[key] * count // len(rank) for key in keys])
