"""Calibration of soft soil to a pull test: reading the table, and what its options may be."""

from pathlib import Path
from typing import Final

import numpy as np

from experiments.calibrate.config import Config
from experiments.common.options import option
from sim.calibration.candidate import Candidate
from sim.calibration.pull_test import PullTest, weight_of
from sim.ground.pull import Pull
from sim.robot.parameters import TRACKS
from trackslip.errors import LogError, require
from trackslip.kinematics import Array
from trackslip.logs.columns import Columns
from trackslip.logs.logfile import read_table

_OF_LOGS: Final = (
    "gear",
    "sensor",
    "clock_offset",
    "bag",
    "table",
    "max_memory",
    "folds",
    "test",
)
"""Options without effect on a pull test."""


def require_pulls(config: Config, base: Candidate) -> None:
    """Raise InvalidValueError for a robot and options that don't go with a pull test."""
    allowed = f'"{TRACKS}": pull tests are of tracks'
    require(base.robot.contact == TRACKS, "robot.contact", base.robot.contact, allowed)
    require(
        config.target != "published",
        "target",
        config.target,
        "on soft soil a table of a pull test, with the columns pull and slip",
    )
    defaults = Config()
    for name in _OF_LOGS:
        value = option(config, name)
        require(value == option(defaults, name), name, value, "left out for a pull test")


def read_pulls(path: Path, base: Candidate) -> PullTest:
    """Read a pull test: a .csv or .parquet table with the columns pull [N] and slip [-], and maybe
    weight [N], by default that of the robot `base`.

    Raises LogError with file, row and column.
    """
    table = read_table(path)
    columns = Columns(table, str(path))
    columns.require(("pull", "slip"))
    if len(table) == 0:
        raise LogError(f"{path}: has no rows")
    pull = _numbers(columns, path, "pull")
    slip = _numbers(columns, path, "slip")
    weight = np.full_like(pull, weight_of(base))
    if "weight" in table.column_names:
        weight = _numbers(columns, path, "weight")
    hint = ": slip is a share, not in per cent" if slip.max() > 1.5 else ""
    _require_rows(path, "slip", slip, (slip > 0) & (slip <= 1), f"above 0 and at most 1{hint}")
    _require_rows(path, "weight", weight, weight > 0, "positive [N]")
    within = np.abs(pull) <= 3 * weight
    _require_rows(path, "pull", pull, within, "at most 3 times the weight [N]")
    return PullTest(slip, pull, weight, Pull.height)


def _numbers(columns: Columns, path: Path, name: str) -> Array:
    """A column (n,) of finite numbers; raises LogError."""
    cells = columns.cells(name)
    if cells.empty.any():
        raise LogError(f"{path}: row {int(cells.empty.argmax()) + 1}, column {name}: is empty")
    wrong = cells.damaged | ~np.isfinite(cells.values)
    if wrong.any():
        raise LogError(f"{path}: {columns.complaint(name, int(wrong.argmax()))}")
    return cells.values


def _require_rows(path: Path, name: str, values: Array, right: np.ndarray, allowed: str) -> None:
    """Raise LogError for the first of the values (n,) that isn't `right` (n,)."""
    if not right.all():
        row = int(right.argmin())
        raise LogError(f"{path}: row {row + 1}, column {name}: {values[row]:g} must be {allowed}")
