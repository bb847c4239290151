"""The numbers of a sweep: a few per grid, or all of them if there is only one grid."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from experiments.measuring.grid import (
    ErrorStatistics,
    GridSummary,
    OuterInner,
    PoseErrors,
    Radii,
    grid_summary,
    published_radii,
)
from experiments.options.grid import SweepConfig
from experiments.report.terminal import print_table
from experiments.storage.plain_json import plain
from experiments.storage.results import SUMMARY_FILE, TABLE_FILE
from experiments.sweep.plan import Run
from experiments.sweep.rows import RunRow
from sim.stopwatch import Stopwatch
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.metrics import rms

IN_FULL = 100
"""Runs of the largest grid for which the errors of all motion methods are compared."""
_MAX_LINES = 40


@dataclass(frozen=True)
class Timing:
    """How long a sweep took."""

    simulated_s: float
    """Simulated time of the runs driven now, all together [s]."""
    driving_s: float
    """Wall-clock time until all were driven [s]."""
    stages: dict[str, float]
    """Work by stage, all workers together [s]."""
    driven: int
    """Runs driven now."""
    taken: int
    """Runs taken from before."""
    wall_s: float
    """Wall-clock time of the whole command [s]."""


@dataclass(frozen=True)
class Grid:
    """One grid of radius x speed; what no run gives is NaN."""

    axes: Mapping[str, Any]
    """What else varies in the sweep, by name: this grid's values."""
    runs: int
    failed: int
    radius: Radii
    slip_by_radius: OuterInner[Array]
    """Mean slip (R,) at each commanded radius [-]."""
    slip_error: OuterInner[ErrorStatistics]
    localization: PoseErrors


@dataclass(frozen=True)
class SweepSummary:
    """What a sweep leaves as its summary.json."""

    grids: list[Grid]
    warnings: list[str]
    in_full: GridSummary | None
    """All numbers of a grid that is the only one, and not too large."""
    runs: list[RunRow]
    made_by: Mapping[str, Any]
    """Code, models and libraries that drove the runs, by their digest."""
    timing: Timing
    bags: Mapping[str, str]
    """Places of the runs' bags in the folder, by the names of the runs."""

    @property
    def failures(self) -> list[RunRow]:
        """The runs that failed."""
        return [row for row in self.runs if row.error is not None]

    def to_json(self) -> dict[str, Any]:
        """The content of the file."""
        content = {
            "grids": self.grids,
            "warnings": self.warnings,
            **({} if self.in_full is None else self.in_full.to_json()),
            "runs": [row.to_json() for row in self.runs],
            "made_by": self.made_by,
            "failures": [{"run": row.run, "error": row.error} for row in self.failures],
            **({"bags": self.bags} if self.bags else {}),
            "timing": self.timing,
        }
        return plain(content)


def grids_of(runs: Sequence[Run], rows: Sequence[RunRow]) -> list[Grid]:
    """Every grid of a sweep, with the rows of its runs."""
    found: dict[tuple[tuple[str, Any], ...], list[RunRow]] = {}
    for run, row in zip(runs, rows, strict=True):
        found.setdefault(run.grid, []).append(row)
    return [_grid(dict(axes), own) for axes, own in found.items()]


def warnings_of(rows: Sequence[RunRow]) -> list[str]:
    """What the user should know of the runs."""
    saturated = (row for row in rows if row.saturated)
    warnings = [f"run {row.run!r}: a motor is at its limit for {row.saturated:.1%} of the time" for row in saturated]
    return warnings + [row.note for row in rows if row.note]


def numbers_in_full(
    config: SweepConfig,
    runs: Sequence[Run],
    rows: Sequence[RunRow],
    read: Callable[[], Iterable[RunLog]],
    watch: Stopwatch,
) -> GridSummary | None:
    """All numbers of a sweep that is a single grid, not too large; `read` gives the logs of its runs, one by one."""
    measured = [row for row in rows if row.v is not None]
    if len({run.grid for run in runs}) > 1 or len(runs) > IN_FULL or not measured:
        return None
    omega, twist = _values(measured, "omega_l", "omega_r"), _values(measured, "v", "w")
    samples = SlipSamples(omega, twist, _values(measured, "slip_l", "slip_r"), tuple(row.run for row in measured))
    radii, speeds = (tuple(dict.fromkeys(run.axes[name] for run in runs)) for name in ("radius", "speed"))
    logs = read()
    with watch.stage("errors of all methods"):
        names = [run.name for run in runs]
        geometry = runs[0].world(1).robot.geometry
        return grid_summary(replace(config, radii=radii, speeds=speeds), names, logs, samples, geometry, watch)


def _grid(axes: Mapping[str, Any], rows: Sequence[RunRow]) -> Grid:
    """Means over the speeds at every radius, errors over all runs."""
    radius = np.array([row.axes["radius"] for row in rows])
    radii = tuple(dict.fromkeys(radius.tolist()))
    slip = _values(rows, "slip_l", "slip_r")
    slip_error = slip - _values(rows, "true_slip_l", "true_slip_r")
    x, y, heading, valid = _values(rows, "rmse_x", "rmse_y", "rmse_heading", "valid_fraction").T

    def means(values: Array) -> Array:
        """Means (R,) over the runs of each radius."""
        return np.array([_mean(values[radius == r]) for r in radii])

    curvature = means(1 / _values(rows, "observed_radius")[:, 0])
    return Grid(
        axes=axes,
        runs=len(rows),
        failed=sum(row.error is not None for row in rows),
        radius=Radii(radii, 1 / curvature, published_radii(radii)),
        slip_by_radius=OuterInner.of(slip, means),
        slip_error=OuterInner.of(slip_error, ErrorStatistics.of),
        localization=PoseErrors(rms(_known(x)), rms(_known(y)), rms(_known(heading)), _mean(valid)),
    )


def print_out(config: SweepConfig, summary: SweepSummary) -> None:
    """Print a single grid radius by radius, or one line for each of several."""
    if len(summary.grids) == 1:
        print_table(
            f"{len(summary.runs)} runs of {summary.runs[0].axes.get('duration', config.duration):g} s",
            ("commanded radius [m]", "observed [m]", "outer slip", "inner slip"),
            _radius_lines(summary.grids[0]),
        )
    else:
        numbers = ("runs", "failed", "tightest [m]", "observed [m]", "outer slip", "inner slip", "slip error, rms")
        lines = [_line(grid) for grid in summary.grids[:_MAX_LINES]]
        title = f"{len(summary.runs)} runs in {len(summary.grids)} grids"
        print_table(title, (*summary.grids[0].axes, *numbers), lines)
        if len(summary.grids) > _MAX_LINES:
            print(f"and {len(summary.grids) - _MAX_LINES} more grids; {TABLE_FILE} has a row for each run")
    _print_some([f"warning: {warning}" for warning in summary.warnings], f"warnings in {SUMMARY_FILE}")
    _print_some([f"failed: {row.run}: {row.error}" for row in summary.failures], f"failures in {TABLE_FILE}")


def _print_some(lines: Sequence[str], where: str) -> None:
    for line in lines[:_MAX_LINES]:
        print(line)
    if len(lines) > _MAX_LINES:
        print(f"and {len(lines) - _MAX_LINES} more {where}")


def _radius_lines(grid: Grid) -> list[tuple[str, ...]]:
    radius, slip = grid.radius, grid.slip_by_radius
    rows = zip(radius.commanded, radius.observed, slip.outer, slip.inner, strict=True)
    return [(f"{given:g}", f"{seen:.3f}", f"{outer:+.4f}", f"{inner:+.4f}") for given, seen, outer, inner in rows]


def _line(grid: Grid) -> tuple[str, ...]:
    """A grid, by its tightest radius."""
    lines = _radius_lines(grid)
    tightest = lines[grid.radius.commanded.index(min(grid.radius.commanded))]
    values = (str(value) for value in grid.axes.values())
    error = np.sqrt(np.mean([e.bias**2 + e.std**2 for e in (grid.slip_error.outer, grid.slip_error.inner)]))
    return (*values, str(grid.runs), str(grid.failed), *tightest, f"{error:.5f}")


def _values(rows: Sequence[RunRow], *names: str) -> Array:
    """Columns (n, len(names)) of the rows; NaN for None."""
    return np.array([[getattr(row, name) for name in names] for row in rows], float)


def _known(values: Array) -> Array:
    return values[~np.isnan(values)]


def _mean(values: Array) -> float:
    return float(_known(values).mean()) if _known(values).size else math.nan
