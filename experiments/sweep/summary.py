"""The numbers of a sweep: a few per grid, or all of them if there is only one grid."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

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
from experiments.report.table import Table
from experiments.storage.plain_json import plain
from experiments.storage.results import SUMMARY_FILE, TABLE_FILE
from experiments.sweep.plan import PlannedRun
from experiments.sweep.table import RunRow
from sim.stopwatch import Stopwatch
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.metrics import rms

IN_FULL = 100
"""Runs of the largest grid for which the errors of all motion methods are compared."""
_MAX_LINES = 40


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

    @classmethod
    def of(cls, axes: Mapping[str, Any], rows: Sequence[RunRow]) -> Self:
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
        return cls(
            axes=axes,
            runs=len(rows),
            failed=sum(row.error is not None for row in rows),
            radius=Radii(radii, 1 / curvature, published_radii(radii)),
            slip_by_radius=OuterInner.of(slip, means),
            slip_error=OuterInner.of(slip_error, ErrorStatistics.of),
            localization=PoseErrors(rms(_known(x)), rms(_known(y)), rms(_known(heading)), _mean(valid)),
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


@dataclass(frozen=True)
class SweepSummary:
    """The numbers of a sweep."""

    runs: Sequence[PlannedRun]
    rows: Sequence[RunRow]
    """One for each run."""
    grids: list[Grid]
    in_full: GridSummary | None
    """All numbers of a grid that is the only one, and not too large."""

    @classmethod
    def of(
        cls,
        runs: Sequence[PlannedRun],
        rows: Sequence[RunRow],
        logs: Callable[[], Iterable[RunLog]],
        watch: Stopwatch,
    ) -> Self:
        """Summarise the rows of runs; `logs` gives the logs of those that did not fail, one by one."""
        found: dict[tuple[tuple[str, Any], ...], list[RunRow]] = {}
        for run, row in zip(runs, rows, strict=True):
            found.setdefault(run.grid, []).append(row)
        grids = [Grid.of(dict(axes), own) for axes, own in found.items()]
        measured = [row for row in rows if row.v is not None]
        in_full = None
        if len(grids) == 1 and len(runs) <= IN_FULL and measured:
            omega, twist, slip = (
                _values(measured, *pair) for pair in (("omega_l", "omega_r"), ("v", "w"), ("slip_l", "slip_r"))
            )
            samples = SlipSamples(omega, twist, slip, tuple(row.run for row in measured))
            config, geometry = runs[0].setting.config, runs[0].world(1).robot.geometry
            with watch.stage("errors of all methods"):
                in_full = grid_summary(config, [run.name for run in runs], logs(), samples, geometry, watch)
        return cls(runs, rows, grids, in_full)

    @property
    def failures(self) -> list[RunRow]:
        """The runs that failed."""
        return [row for row in self.rows if row.error is not None]

    @property
    def warnings(self) -> list[str]:
        """Saturated motors, and what could not be used of the runs."""
        saturated = (row for row in self.rows if row.saturated)
        limited = [f"run {row.run!r}: a motor is at its limit for {row.saturated:.1%} of the time" for row in saturated]
        return limited + [row.note for row in self.rows if row.note]

    def to_json(self) -> dict[str, Any]:
        """The content of summary.json."""
        content = {
            "grids": self.grids,
            "warnings": self.warnings,
            **({} if self.in_full is None else self.in_full.to_json()),
            "runs": [row.to_json() for row in self.rows],
            "failures": [{"run": row.run, "error": row.error} for row in self.failures],
        }
        return plain(content)

    def print(self) -> None:
        """Print a single grid radius by radius, or one line for each of several."""
        if len(self.grids) == 1:
            title = f"{len(self.rows)} runs of {self.runs[0].duration:g} s"
            header: tuple[str, ...] = ("commanded radius [m]", "observed [m]", "outer slip", "inner slip")
            Table(title, header, self.grids[0].lines, align="r").print()
        else:
            numbers = ("runs", "failed", "tightest [m]", "observed [m]", "outer slip", "inner slip", "slip error, rms")
            header = (*self.grids[0].axes, *numbers)
            lines = [grid.line for grid in self.grids[:_MAX_LINES]]
            Table(f"{len(self.rows)} runs in {len(self.grids)} grids", header, lines, align="r").print()
            if len(self.grids) > _MAX_LINES:
                print(f"and {len(self.grids) - _MAX_LINES} more grids; {TABLE_FILE} has a row for each run")
        _print_some([f"warning: {warning}" for warning in self.warnings], f"warnings in {SUMMARY_FILE}")
        _print_some([f"failed: {row.run}: {row.error}" for row in self.failures], f"failures in {TABLE_FILE}")


def all_failed(failures: Sequence[RunRow]) -> str:
    """Why a sweep has no run."""
    first, *others = failures
    return f"all {len(failures)} runs fail, the first, {first.run!r}: {first.error}" if others else str(first.error)


def _print_some(lines: Sequence[str], where: str) -> None:
    for line in lines[:_MAX_LINES]:
        print(line)
    if len(lines) > _MAX_LINES:
        print(f"and {len(lines) - _MAX_LINES} more {where}")


def _values(rows: Sequence[RunRow], *names: str) -> Array:
    """Columns (n, len(names)) of the rows; NaN for None."""
    return np.array([[getattr(row, name) for name in names] for row in rows], float)


def _known(values: Array) -> Array:
    return values[~np.isnan(values)]


def _mean(values: Array) -> float:
    return float(_known(values).mean()) if _known(values).size else math.nan
