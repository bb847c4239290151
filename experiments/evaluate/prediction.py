"""The errors of models that predict the same log, and what in the log disturbs them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.evaluate.log import Log
from experiments.evaluate.models import FIRST, GAINS, TODAY, LawModel, Model, Spec
from trackslip.errors import counted
from trackslip.logs.file_format import known_manifest
from trackslip.logs.runlog import RunLog
from trackslip.odometry.checks import better_clock_offset, jumps
from trackslip.odometry.evaluation import LENGTHS, OdometryErrors, RelativeErrors, errors_of
from trackslip.odometry.trajectory_errors import Trajectory
from trackslip.slip.law_file import NO_SLIP

FARTHEST = 10.0
"""Distance ahead by which models are compared if the drives are long enough [m]."""
_MANY = 0.005  # share of outlying poses that is told
_MIN_POSES = 2
_MIN_PAIRS = 10  # from which a median and a 90 % quantile can be told
_MARGIN = 1e-3  # so that times ascend [s]


@dataclass(frozen=True)
class Prediction:
    """A model's predictions of a log."""

    label: str
    name: str
    model: Model
    """Of the first part of the log; those of the others have the same label and name."""
    errors: OdometryErrors

    def ahead(self, length: float, unit: str) -> RelativeErrors | None:
        """Errors after a distance [m] or a time [s]; None if there are few pairs."""
        errors = (self.errors.after_metres if unit == "m" else self.errors.after_seconds).get(length)
        return errors if errors is not None and errors.count >= _MIN_PAIRS else None

    def drive(self, name: str) -> Trajectory:
        """Measured and predicted poses of a drive."""
        return next(one for one in self.errors.trajectories if one.name == name)

    @property
    def summary(self) -> dict[str, Any]:
        """Content of a summary.json."""
        errors, model = self.errors, self.model
        about = {"law": self.name, "sensor": model.sensor, "clock_offset": model.clock_offset}
        relative = {
            name: {f"{length:g}": ahead for length, ahead in getattr(errors, name).items()}
            for name in ("after_metres", "after_seconds")
        }
        return about | {"aligned": errors.aligned, "from_first": errors.from_first} | relative


def predictions(log: Log, models: Sequence[Sequence[Model]]) -> list[Prediction]:
    """The predictions by the models of each part, which are of the same poses.

    Without folds, these are the poses that encoders cover by the clock of every model; with folds, which windows may be
    short for, encoders go on at their last speeds. Raises LogError if there are none.
    """
    parts, notes = [], list[str]()
    for k, of_part in enumerate(models):
        rows = log.take(log.part == k)
        clocks = [model.clock_offset for model in of_part]
        if log.parts > 1:
            parts.append(replace(rows, logs=[_continued(one, clocks) for one in rows.logs], driven=rows.logs))
            continue
        logs = [_covered(one, clocks) for one in rows.logs]
        notes += [one for one in logs if isinstance(one, str)]
        parts.append(replace(rows, logs=[one for one in logs if isinstance(one, RunLog)]))
    found = []
    for same in zip(*models, strict=True):
        pairs = [(model, part) for model, part in zip(same, parts, strict=True) if part.logs or log.samples is not None]
        trajectories = [one for model, part in pairs for one in model.trajectories(part)]
        found.append(Prediction(same[0].label, same[0].name, same[0], errors_of(trajectories, notes)))
    return found


def _covered(log: RunLog, clocks: Sequence[float]) -> RunLog | str:
    """A log with the poses that encoders cover by each clock, encoder clock minus pose clock [s]; or why it has few."""
    time = log.time
    covered = log.is_valid & (time + min(clocks) >= time[0]) & (time + max(clocks) <= time[-1])
    if covered.sum() >= _MIN_POSES:
        return replace(log, valid=covered)
    count = f"{int(covered.sum())} of {counted(int(log.is_valid.sum()), 'measured pose')}"
    return f"run {log.run!r}: encoders were read at {count}, needs at least {_MIN_POSES}"


def _continued(log: RunLog, clocks: Sequence[float]) -> RunLog:
    """A log whose encoders go on at their first and last speeds until they cover all poses by each clock."""
    rows = np.clip(np.arange(-1, len(log.time) + 1), 0, len(log.time) - 1)
    time, valid = log.time[rows], log.is_valid[rows]
    time[[0, -1]] += min(-_MARGIN, *clocks), max(_MARGIN, *clocks)
    valid[[0, -1]] = False
    command = None if log.command is None else log.command[rows]
    return RunLog(log.run, time, log.omega[rows], log.pose[rows], command, valid=valid, metadata=log.metadata)


def of_laws(found: Sequence[Prediction]) -> list[Prediction]:
    """The predictions by slip laws."""
    return [one for one in found if isinstance(one.model, LawModel) and one.name not in (TODAY, GAINS, NO_SLIP)]


def decisive(found: Sequence[Prediction]) -> tuple[float, str]:
    """The distance or time ahead by which models are compared, and its unit; all have it."""
    for length, unit in ((FARTHEST, "m"), *((at, "s") for at in reversed(LENGTHS))):
        if all(one.ahead(length, unit) for one in found):
            return length, unit
    return FIRST, "s"


def best(found: Sequence[Prediction]) -> Prediction:
    """The prediction with the smallest median error of the position at the decisive length."""

    def error(one: Prediction) -> float:
        ahead = one.ahead(*decisive(found))
        return float("inf") if ahead is None or ahead.position is None else ahead.position.median

    return min(found, key=error)


def doubts(found: Sequence[Prediction], log: Log) -> list[str]:
    """Lines about a clock that fits clearly better, else about poses that jump; none for a log in parts."""
    if log.parts > 1 or not log.logs:
        return []
    model = next((one for one in found if one.name != NO_SLIP), found[0]).model
    if isinstance(model, LawModel):
        better = better_clock_offset(log.logs, model.odometry, model.sensor, model.clock_offset)
        if better is not None:
            clocks = f"{better:z.3f} s ahead of the poses', not {model.clock_offset:z.3f} s"
            return [f"the encoders' clock seems to be {clocks}: try --clock-offset={better:z.3f}"]
    lines = []
    for drive in best(found).errors.trajectories:
        outlying, lasting = jumps(drive)
        what = [counted(outlying, "outlying pose")] if outlying > _MANY * len(drive.time) else []
        what += [f"{counted(lasting, 'lasting jump')} of the poses"] if lasting else []
        if what:
            lines.append(f"run {drive.name!r}: {' and '.join(what)} count in all errors; medians tell more of the law")
    return lines


def identified_from(log: Path, specs: Sequence[Spec]) -> list[str]:
    """Warnings about laws that were identified from this very log."""
    lines = []
    for folder in dict.fromkeys(file for file, _ in specs if file is not None and file.is_dir()):
        about = known_manifest(folder)
        if about.get("command") == "identify" and Path(about["config"]["path"]).resolve() == log.resolve():
            lines.append(f"{folder}: identified from this log; on other driving its laws' errors may be larger")
    return lines
