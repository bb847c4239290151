"""Logs of any kind: folders of results, Parquet, CSV, bags."""

from __future__ import annotations

import warnings
from pathlib import Path

from trackslip.errors import InvalidValueError, LogWarning
from trackslip.logs.logfile import RUNS, read_log, runs_file
from trackslip.logs.runlog import RunLog
from trackslip.logs.table_reader import ReadRuns
from trackslip.ros.choice import AUTOMATIC, BagChoice
from trackslip.ros.drive_log import read_bags
from trackslip.ros.files import is_bag


def load(path: str | Path, bag: BagChoice | None = None) -> list[RunLog]:
    """The runs in a folder of results, in a `.parquet` or `.csv` file, or in bags of ROS 1 and ROS 2.

    Rows and runs that cannot be read are left out, each with a LogWarning that says why. `bag` says what to take from
    a bag that leaves a doubt.

    Raises:
        LogError: if no run can be read, or the file is damaged; the message is one line.
        TrackslipError: for a bag, without the package rosbags.
    """
    read = read_runs_of(Path(path), bag or AUTOMATIC)
    for line in read.warnings:
        warnings.warn(f"{path}: {line}", LogWarning, stacklevel=2)
    return list(read.runs)


def read_runs_of(path: Path, bag: BagChoice = AUTOMATIC) -> ReadRuns:
    """The runs in a log of any kind, and what was left out of it; raises LogError if no run can be read."""
    if holds_bags(path):
        return read_bags(path, bag)
    refuse_choice(path, bag)
    return read_log(runs_file(path))


def holds_bags(path: Path) -> bool:
    """Whether a path is a bag, or a folder that holds some and is no folder of results."""
    try:
        return is_bag(path) and not (path / RUNS).is_file()
    except OSError:
        return False


def refuse_choice(path: Path, bag: BagChoice) -> None:
    """Raise InvalidValueError for choices that a log which is no bag leaves without effect."""
    for name, value in vars(bag).items():
        if value is not None:
            raise InvalidValueError(name, value, f"left out: {path} is no bag")
