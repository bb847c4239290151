"""The summary of a sweep: numbers of each grid of radius x speed, warnings and failures."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from experiments.common.plain_json import plain
from experiments.common.results import SUMMARY_FILE, TABLE_FILE
from experiments.common.sweep import Row
from experiments.common.table import Table
from experiments.grid.plan import PlannedRun
from experiments.simulate.grid_summary import (
    ErrorStatistics,
    GridSummary,
    OuterInner,
    PoseAccuracy,
    Radii,
    grid_summary,
    published_radii,
)
from sim.stopwatch import Stopwatch
from trackslip.errors import counted
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.metrics import rms

IN_FULL = 100
"""Runs of the largest grid for which the errors of all motion methods are compared."""
_MAX_LINES = 40


@dataclass(frozen=True)
class RunGrid:
    """One grid of radius x speed; what no run gives is NaN."""

    axes: Mapping[str, Any]
    """This grid's values of the other axes of the sweep, by name."""
    runs: int
    failed: int
    radius: Radii
    slip_by_radius: OuterInner[Array]
    """Mean slip (R,) at each commanded radius [-]."""
    slip_error: OuterInner[ErrorStatistics]
    localization: PoseAccuracy

    @classmethod
    def of(cls, axes: Mapping[str, Any], rows: Sequence[Row]) -> Self:
        """Means over the speeds at every radius, errors over all runs."""
        radius = np.array([row["radius"] for row in rows])
        radii = tuple(dict.fromkeys(radius.tolist()))
        slip = _values(rows, "slip_l", "slip_r")
        x, y, heading, valid = _values(rows, "rmse_x", "rmse_y", "rmse_heading", "valid_fraction").T

        def means(values: Array) -> Array:
            """Means (R,) over the runs of each radius."""
            return np.array([_mean(values[radius == r]) for r in radii])

        curvature = means(1 / _values(rows, "observed_radius")[:, 0])
        return cls(
            axes=axes,
            runs=len(rows),
            failed=len(_failed(rows)),
            radius=Radii(radii, 1 / curvature, published_radii(radii)),
            slip_by_radius=OuterInner.of(slip, means),
            slip_error=OuterInner.of(slip - _values(rows, "true_slip_l", "true_slip_r"), ErrorStatistics.of),
            localization=PoseAccuracy(rms(_known(x)), rms(_known(y)), rms(_known(heading)), _mean(valid)),
        )

    @property
    def lines(self) -> list[tuple[str, ...]]:
        """Commanded and observed radius and mean slips, radius by radius."""
        radius, slip = self.radius, self.slip_by_radius
        rows = zip(radius.commanded, radius.observed, slip.outer, slip.inner, strict=True)
        return [(f"{given:g}", f"{seen:.3f}", f"{outer:+.4f}", f"{inner:+.4f}") for given, seen, outer, inner in rows]

    @property
    def line(self) -> tuple[str, ...]:
        """The grid's values of the axes, its numbers of runs, its tightest radius, and its error of slip."""
        tightest = self.lines[self.radius.commanded.index(min(self.radius.commanded))]
        error = np.sqrt(np.mean([e.bias**2 + e.std**2 for e in (self.slip_error.outer, self.slip_error.inner)]))
        return (*map(str, self.axes.values()), str(self.runs), str(self.failed), *tightest, f"{error:.5f}")


def grids_of(runs: Sequence[PlannedRun], rows: Sequence[Row]) -> list[RunGrid]:
    """The grids of a sweep, from the rows of its runs."""
    found: dict[tuple[tuple[str, Any], ...], list[Row]] = {}
    for run, row in zip(runs, rows, strict=True):
        found.setdefault(run.grid, []).append(row)
    return [RunGrid.of(dict(axes), own) for axes, own in found.items()]


def in_full(
    runs: Sequence[PlannedRun], rows: Sequence[Row], logs: Callable[[], Iterable[RunLog]], watch: Stopwatch
) -> GridSummary | None:
    """All numbers of a grid that is the only one of a sweep, and not too large; `logs` of runs that didn't fail."""
    measured = [row for row in rows if row.get("v") is not None]
    if len({run.grid for run in runs}) > 1 or len(runs) > IN_FULL or not measured:
        return None
    pairs = (("omega_l", "omega_r"), ("v", "w"), ("slip_l", "slip_r"))
    omega, twist, slip = (_values(measured, *pair) for pair in pairs)
    samples = SlipSamples(omega, twist, slip, tuple(row["run"] for row in measured))
    config, geometry = runs[0].setting.config, runs[0].world(1).robot.geometry
    with watch.stage("errors of all methods"):
        return grid_summary(config, [run.name for run in runs], logs(), samples, geometry, watch)


def summary_of(grids: Sequence[RunGrid], whole: GridSummary | None, rows: Sequence[Row]) -> dict[str, Any]:
    """The content of summary.json; `whole` has all numbers of a single grid."""
    failures = [{"run": row["run"], "error": row["error"]} for row in _failed(rows)]
    content = {"grids": grids, "warnings": _warnings(rows), **({} if whole is None else whole.to_json())}
    return plain(content | {"runs": rows, "failures": failures})


def print_sweep(grids: Sequence[RunGrid], rows: Sequence[Row], duration: float) -> None:
    """Print a single grid radius by radius, or one line for each of several; then warnings and failures."""
    if len(grids) == 1:
        header: tuple[str, ...] = ("commanded radius [m]", "observed [m]", "outer slip", "inner slip")
        Table(f"{counted(len(rows), 'run')} of {duration:g} s", header, grids[0].lines, align="r").print()
    else:
        numbers = ("runs", "failed", "tightest [m]", "observed [m]", "outer slip", "inner slip", "slip error, rms")
        lines = [grid.line for grid in grids[:_MAX_LINES]]
        title = f"{counted(len(rows), 'run')} in {counted(len(grids), 'grid')}"
        Table(title, (*grids[0].axes, *numbers), lines, align="r").print()
        if len(grids) > _MAX_LINES:
            print(f"and {len(grids) - _MAX_LINES} more grids; {TABLE_FILE} has a row for each run")
    _print_some([f"warning: {warning}" for warning in _warnings(rows)], f"warnings in {SUMMARY_FILE}")
    _print_some([f"failed: {row['run']}: {row['error']}" for row in _failed(rows)], f"failures in {TABLE_FILE}")


def all_failed(rows: Sequence[Row]) -> str:
    """The reason why a sweep has no run."""
    first, *others = rows
    return f"all {len(rows)} runs fail, the first, {first['run']!r}: {first['error']}" if others else first["error"]


def _warnings(rows: Sequence[Row]) -> list[str]:
    """Saturated motors, and what could not be used of the runs."""
    limited = [
        f"run {row['run']!r}: a motor is at its limit for {row['saturated']:.1%} of the time"
        for row in rows
        if row.get("saturated")
    ]
    return limited + [row["note"] for row in rows if row.get("note")]


def _failed(rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if row["error"] is not None]


def _print_some(lines: Sequence[str], where: str) -> None:
    for line in lines[:_MAX_LINES]:
        print(line)
    if len(lines) > _MAX_LINES:
        print(f"and {len(lines) - _MAX_LINES} more {where}")


def _values(rows: Sequence[Row], *names: str) -> Array:
    """Columns (n, len(names)) of the rows; NaN for None."""
    return np.array([[row.get(name) for name in names] for row in rows], float)


def _known(values: Array) -> Array:
    return values[~np.isnan(values)]


def _mean(values: Array) -> float:
    return float(_known(values).mean()) if _known(values).size else math.nan
