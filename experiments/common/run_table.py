"""The table of a grid's runs: its columns, and the selection of runs by axis values."""

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from experiments.common.results import TABLE_FILE
from trackslip.errors import InvalidValueError, LogError, one_of
from trackslip.logs.columns import Columns
from trackslip.logs.logfile import read_table
from trackslip.logs.schema import NO_UNIT, PURE, Column

COLUMNS: Final = {
    column.name: column
    for column in (
        Column("run", NO_UNIT, "name of the run: its log in runs.parquet"),
        Column("id", NO_UNIT, "hash of the run's options, robot, ground and seed"),
        Column("error", NO_UNIT, "reason why the run failed; null if it succeeded"),
        Column("omega_l", "rad/s", "measured speed of the left sprocket"),
        Column("omega_r", "rad/s", "measured speed of the right sprocket"),
        Column("v", "m/s", "measured forward speed"),
        Column("w", "rad/s", "measured yaw rate"),
        Column("observed_radius", "m", "measured radius, positive to the left"),
        Column("slip_l", PURE, "measured slip of the left track"),
        Column("slip_r", PURE, "measured slip of the right track"),
        Column("true_slip_l", PURE, "true slip of the left track"),
        Column("true_slip_r", PURE, "true slip of the right track"),
        Column(
            "note",
            NO_UNIT,
            "parts of the run that could not be used, and why; null if there are none",
        ),
        Column("rmse_x", "m", "root mean square error of the poses along x"),
        Column("rmse_y", "m", "root mean square error of the poses along y"),
        Column("rmse_heading", "rad", "root mean square error of the headings"),
        Column("valid_fraction", PURE, "share of the scans that gave a pose"),
        Column("saturated", PURE, "share of the time with a motor at its limit, the worse track"),
        Column("saturated_motor", NO_UNIT, "the motor at its limit, left or right; null if none"),
        Column("torque_at_hand", "N m", "median torque of that motor while it was too weak"),
        Column("torque_needed", "N m", "median torque that its set points took meanwhile"),
    )
}
"""Columns other than the sweep's axes, which follow `id`."""
SOIL_COLUMNS: Final = {
    column.name: column
    for column in (
        Column("sinkage", "m", "depth of the ruts, in the last third of the run"),
        Column(
            "resistance",
            "N",
            "force of compaction on both tracks, in the last third; null if immobilised",
        ),
        Column("drawbar_slip", PURE, "mean slip of both belts, in the last third"),
        Column(
            "efficiency",
            PURE,
            "power of the pull over that of the belts, in the last third; null if immobilised",
        ),
        Column("slip_grows", NO_UNIT, "whether the slip changes by more than 0.01 meanwhile"),
        Column("immobilised", NO_UNIT, "whether the tracks slip by more than 0.95 at the end"),
    )
}
"""Further columns, of sweeps with runs on soft soil."""
_SHOWN: Final = 10  # most axis values that a message lists


def chosen(folder: Path, where: Sequence[str]) -> set[str]:
    """Names of the runs for which every NAME=VALUE in `where` holds.

    Raises InvalidValueError for an axis or value that is not in the sweep, LogError for a folder
    without a run table.
    """
    if not (folder / TABLE_FILE).exists():
        raise LogError("holds no runs of a sweep: --where must be left out")
    table = read_table(folder / TABLE_FILE)
    Columns(table, str(folder / TABLE_FILE)).require(("run",))
    rows: list[dict[str, Any]] = table.to_pylist()
    measured = COLUMNS | SOIL_COLUMNS
    axes = [name for name in rows[0] if name not in measured] if rows else []
    for text in where:
        name, _, value = text.partition("=")
        if name not in axes:
            raise InvalidValueError("where", text, f"NAME=VALUE with {one_of(axes, name)}")
        there = list(dict.fromkeys(str(row[name]) for row in rows))
        rows = [row for row in rows if _is(row[name], value)]
        if not rows:
            raise InvalidValueError("where", text, f"{name}=one of {', '.join(there[:_SHOWN])}")
    if any(row["run"] is None for row in rows):
        raise LogError(f"{folder / TABLE_FILE}: column run: empty in a chosen row")
    return {str(row["run"]) for row in rows}


def _is(value: Any, text: str) -> bool:
    """Whether `text` denotes `value`."""
    if str(value) == text or (isinstance(value, bool) and str(value).lower() == text):
        return True
    with contextlib.suppress(ValueError):
        return isinstance(value, int | float) and float(text) == value
    return False
