"""The summary of a sweep: numbers for each grid of radius x speed, warnings and failures."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from experiments.common.plain_json import plain
from experiments.common.results import SUMMARY_FILE, TABLE_FILE
from experiments.common.sweep import Row
from experiments.common.table import Table
from experiments.grid.plan import PlannedRun
from experiments.simulate.grid_summary import GridSlips, known_mean, saturation_warning
from sim.runs.run_recorder import Saturation
from trackslip.errors import counted
from trackslip.kinematics import Array

_MAX_LINES: Final = 40


@dataclass(frozen=True)
class RunGrid(GridSlips):
    """One grid of radius x speed; values that no run provides are NaN."""

    axes: Mapping[str, Any]
    """This grid's values on the other axes of the sweep, by name."""
    runs: int
    failed: int
    localization: Mapping[str, float]
    """Root mean square errors of the poses, and the share of poses that were measured, over all
    runs.
    """

    @classmethod
    def of_rows(cls, axes: Mapping[str, Any], rows: Sequence[Row]) -> "RunGrid":
        """A grid from the rows of its runs: means over the speeds at every radius, errors over all
        runs.
        """
        slip = _values(rows, "slip_l", "slip_r")
        true_slip = _values(rows, "true_slip_l", "true_slip_r")
        commanded, observed = _values(rows, "radius", "observed_radius").T
        slips = GridSlips.of(commanded, observed, slip, true_slip)
        errors = ("rmse_x", "rmse_y", "rmse_heading")
        localization = {name: math.sqrt(known_mean(_values(rows, name) ** 2)) for name in errors}
        localization["valid_fraction"] = known_mean(_values(rows, "valid_fraction"))
        return cls(
            **vars(slips),
            axes=axes,
            runs=len(rows),
            failed=len(failed(rows)),
            localization=localization,
        )

    @property
    def lines(self) -> list[tuple[str, ...]]:
        """Table rows, one per radius: commanded radius, observed radius, and mean slips."""
        radius = self.radius
        slip = self.slip_by_radius
        rows = zip(radius.commanded, radius.observed, slip.outer, slip.inner, strict=True)
        return [
            (f"{given:g}", f"{seen:.3f}", f"{outer:+.4f}", f"{inner:+.4f}")
            for given, seen, outer, inner in rows
        ]

    @property
    def line(self) -> tuple[str, ...]:
        """A table row for the grid: values on the axes, numbers of runs, line of the smallest
        radius, slip error.
        """
        tightest = self.lines[int(np.argmin(self.radius.commanded))]
        errors = (self.slip_error.outer, self.slip_error.inner)
        mean_squares = [error.bias**2 + error.std**2 for error in errors]
        error = math.sqrt(np.mean(mean_squares))
        return (
            *map(str, self.axes.values()),
            str(self.runs),
            str(self.failed),
            *tightest,
            f"{error:.5f}",
        )


def grids_of(runs: Sequence[PlannedRun], rows: Sequence[Row]) -> list[RunGrid]:
    """The grids in a sweep, from the rows of its runs."""
    pairs = itertools.groupby(zip(runs, rows, strict=True), key=lambda pair: pair[0].setting.axes)
    return [RunGrid.of_rows(axes, [row for _, row in group]) for axes, group in pairs]


def summary_of(grids: Sequence[RunGrid], rows: Sequence[Row]) -> dict[str, Any]:
    """The content of summary.json."""
    failures = [{"run": row["run"], "error": row["error"]} for row in failed(rows)]
    return plain(
        {"grids": grids, "warnings": warnings_of(rows), "runs": rows, "failures": failures}
    )


def print_sweep(grids: Sequence[RunGrid], rows: Sequence[Row], duration: float) -> None:
    """Print a single grid with a line per radius, or several grids with a line each; then warnings
    and failures.
    """
    sweep_table(grids, len(rows), duration).print()
    more = len(grids) - _MAX_LINES
    if more > 0:
        print(f"and {more} more grids; {TABLE_FILE} has a row for each run")
    notices = [f"warning: {warning}" for warning in warnings_of(rows)]
    notices += [f"failed: {row['run']}: {row['error']}" for row in failed(rows)]
    for notice in notices[:_MAX_LINES]:
        print(notice)
    more = len(notices) - _MAX_LINES
    if more > 0:
        print(f"and {more} more warnings and failures in {SUMMARY_FILE}")


def sweep_table(grids: Sequence[RunGrid], runs: int, duration: float) -> Table:
    """A table of a single grid of `runs` runs that last `duration` [s], with a row per radius, or
    of the first grids, with a row each.
    """
    if len(grids) == 1:
        return _grid_table(grids[0], runs, duration)
    return _grids_table(grids, runs)


def _grid_table(grid: RunGrid, runs: int, duration: float) -> Table:
    """A table of a single grid, with a row per radius."""
    header = ("commanded radius [m]", "observed [m]", "outer slip", "inner slip")
    title = f"{counted(runs, 'run')} of {duration:g} s"
    return Table(title, header, grid.lines, align="r")


def _grids_table(grids: Sequence[RunGrid], runs: int) -> Table:
    """A table of the first grids, with a row each."""
    numbers = (
        "runs",
        "failed",
        "tightest [m]",
        "observed [m]",
        "outer slip",
        "inner slip",
        "slip error, rms",
    )
    title = f"{counted(runs, 'run')} in {counted(len(grids), 'grid')}"
    lines = [grid.line for grid in grids[:_MAX_LINES]]
    return Table(title, (*grids[0].axes, *numbers), lines, align="r")


def all_failed(rows: Sequence[Row]) -> str:
    """The message for a sweep in which all runs failed."""
    error: str = rows[0]["error"]
    if len(rows) == 1:
        return error
    return f"all {len(rows)} runs fail, the first, {rows[0]['run']!r}: {error}"


def warnings_of(rows: Sequence[Row]) -> list[str]:
    """Warnings on saturated motors, and on parts of runs that could not be used."""
    saturated = [_saturation_warning(row) for row in rows if row.get("saturated")]
    notes = [row["note"] for row in rows if row.get("note")]
    return saturated + notes


def _saturation_warning(row: Row) -> str:
    saturation = Saturation(
        motor=row["saturated_motor"],
        share=row["saturated"],
        torque=row["torque_at_hand"],
        needed=row["torque_needed"],
    )
    return saturation_warning(row["run"], saturation)


def failed(rows: Sequence[Row]) -> list[Row]:
    """The rows of the runs that failed."""
    return [row for row in rows if row["error"] is not None]


def _values(rows: Sequence[Row], *names: str) -> Array:
    """Columns (n, len(names)) of the rows; NaN for None."""
    return np.array([[row.get(name) for name in names] for row in rows], float)
