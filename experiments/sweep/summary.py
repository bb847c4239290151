"""The numbers of a sweep: of each of its grids, and in full of one that is the only one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from experiments.measuring.grid import grid_summary, published_radii
from experiments.options.grid import SweepConfig
from experiments.report.terminal import print_table
from experiments.storage.results import SUMMARY_FILE, TABLE_FILE
from experiments.sweep.plan import Run
from sim.stopwatch import Stopwatch
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.metrics import rms

IN_FULL = 100
"""Runs of the largest grid whose errors are compared for all motion methods."""
_MAX_LINES = 40
_SATURATED = "run {run!r}: a motor is at its limit for {saturated:.1%} of the time"
_OUTER, _INNER = "r", "l"  # the runs turn left
Row = dict[str, Any]


def of(
    config: SweepConfig,
    runs: Sequence[Run],
    rows: Sequence[Row],
    read: Callable[[], Sequence[RunLog]],
    watch: Stopwatch,
) -> dict[str, Any]:
    """Summary of the `runs` with their `rows`; `read` gives the logs of those that were driven to the end."""
    grids: dict[tuple[tuple[str, Any], ...], list[Row]] = {}
    for run, row in zip(runs, rows, strict=True):
        grids.setdefault(run.grid, []).append(row)
    found: dict[str, Any] = {"grids": [_grid(dict(axes), own) for axes, own in grids.items()]}
    found["warnings"] = [
        *(_SATURATED.format(**row) for row in rows if row.get("saturated")),
        *(row["note"] for row in rows if row.get("note")),
    ]
    if len(grids) == 1 and len(runs) <= IN_FULL and any(row.get("v") is not None for row in rows):
        found |= _in_full(config, runs, rows, read(), watch)
    return found


def _in_full(
    config: SweepConfig, runs: Sequence[Run], rows: Sequence[Row], logs: Sequence[RunLog], watch: Stopwatch
) -> dict[str, Any]:
    """What `grid_summary` tells of the only grid."""
    measured = [row for row in rows if row.get("v") is not None]
    omega, twist, slip = (
        np.array([[row[name] for name in names] for row in measured])
        for names in (("omega_l", "omega_r"), ("v", "w"), ("slip_l", "slip_r"))
    )
    samples = SlipSamples(omega, twist, slip, tuple(row["run"] for row in measured))
    radii, speeds = (tuple(dict.fromkeys(run.axes[name] for run in runs)) for name in ("radius", "speed"))
    with watch.stage("errors of all methods"):
        names = [run.name for run in runs]
        geometry = runs[0].world(1).robot.geometry
        return grid_summary(
            replace(config, radii=radii, speeds=speeds), names, logs, samples, geometry, watch
        ).to_json()


def _grid(axes: Mapping[str, Any], rows: Sequence[Row]) -> dict[str, Any]:
    """One grid: means over its speeds at every radius, errors over all its runs."""
    radii = list(dict.fromkeys(row["radius"] for row in rows))
    outer, inner = (_values(rows, f"slip_{track}") for track in (_OUTER, _INNER))
    true_outer, true_inner = (_values(rows, f"true_slip_{track}") for track in (_OUTER, _INNER))
    radius = np.array([row["radius"] for row in rows])
    curvature = 1 / _values(rows, "observed_radius")
    return {
        "axes": dict(axes),
        "runs": len(rows),
        "failed": sum(row["error"] is not None for row in rows),
        "radius": {
            "commanded": radii,
            "observed": [1 / _mean(curvature[radius == r]) for r in radii],
            "published": published_radii(radii),
        },
        "slip_by_radius": {
            "outer": [_mean(outer[radius == r]) for r in radii],
            "inner": [_mean(inner[radius == r]) for r in radii],
        },
        "slip_error": {"outer": _error(outer - true_outer), "inner": _error(inner - true_inner)},
        "localization": {
            **{name: rms(_known(_values(rows, name))) for name in ("rmse_x", "rmse_y", "rmse_heading")},
            "valid_fraction": _mean(_values(rows, "valid_fraction")),
        },
    }


def print_out(config: SweepConfig, runs: Sequence[Run], found: Mapping[str, Any]) -> None:
    """Print the only grid by radius, or a line for each of several."""
    grids = found["grids"]
    if len(grids) == 1:
        only = grids[0]
        taken = replace(config, radii=tuple(only["radius"]["commanded"]))
        print_table(
            f"{len(runs)} runs of {runs[0].config.duration:g} s",
            ("commanded radius [m]", "observed [m]", "outer slip", "inner slip"),
            _radius_rows(taken, only),
        )
    else:
        axes = list(grids[0]["axes"])
        header = (
            *axes,
            "runs",
            "failed",
            "tightest [m]",
            "observed [m]",
            "outer slip",
            "inner slip",
            "slip error, rms",
        )
        print_table(f"{len(runs)} runs in {len(grids)} grids", header, [_line(grid) for grid in grids[:_MAX_LINES]])
        if len(grids) > _MAX_LINES:
            print(f"and {len(grids) - _MAX_LINES} more grids; {TABLE_FILE} has a row for each run")
    for warning in found["warnings"][:_MAX_LINES]:
        print(f"warning: {warning}")
    if len(found["warnings"]) > _MAX_LINES:
        print(f"and {len(found['warnings']) - _MAX_LINES} more warnings in {SUMMARY_FILE}")
    for failure in found["failures"][:_MAX_LINES]:
        print(f"failed: {failure['run']}: {failure['error']}")
    if len(found["failures"]) > _MAX_LINES:
        print(f"and {len(found['failures']) - _MAX_LINES} more failures in {TABLE_FILE}")


def _radius_rows(config: SweepConfig, summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Means over the speeds, a row a radius."""
    columns = (summary["radius"]["observed"], summary["slip_by_radius"]["outer"], summary["slip_by_radius"]["inner"])
    return [
        (f"{commanded:g}", f"{radius:.3f}", f"{outer:+.4f}", f"{inner:+.4f}")
        for commanded, radius, outer, inner in zip(config.radii, *columns, strict=True)
    ]


def _line(grid: Mapping[str, Any]) -> tuple[str, ...]:
    """A grid by its tightest radius."""
    radii = grid["radius"]["commanded"]
    k = radii.index(min(radii))
    slips = [grid["slip_by_radius"][track][k] for track in ("outer", "inner")]
    error = [grid["slip_error"][track] for track in ("outer", "inner")]
    both = np.sqrt(np.mean([e["bias"] ** 2 + e["std"] ** 2 for e in error]))
    return (
        *(str(value) for value in grid["axes"].values()),
        str(grid["runs"]),
        str(grid["failed"]),
        f"{radii[k]:g}",
        f"{grid['radius']['observed'][k]:.3f}",
        *(f"{slip:+.4f}" for slip in slips),
        f"{both:.5f}",
    )


def _values(rows: Sequence[Row], name: str) -> Array:
    return np.array([np.nan if row.get(name) is None else row[name] for row in rows], float)


def _known(values: Array) -> Array:
    return values[~np.isnan(values)]


def _mean(values: Array) -> float:
    return float(_known(values).mean()) if _known(values).size else float("nan")


def _error(error: Array) -> dict[str, float]:
    known = _known(error)
    return {"bias": _mean(error), "std": float(known.std()) if known.size else float("nan")}
