"""The page of a sensitivity study: slip errors under each disturbance, as a figure and as a table."""

from collections.abc import Mapping, Sequence
from math import degrees
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.report.colours import BLUE, ORANGE
from experiments.report.figures.style import legend_below, log_ticks, margin_for, styled, subplots
from experiments.report.formats import MISSING, number
from experiments.report.page import Bullets, Page, Plot, Section
from experiments.report.table import Table

_OF_SLIP = ("", "outer bias", "std", "largest", "inner bias", "std", "largest")
_HEADER = (*_OF_SLIP, "x [mm]", "y [mm]", "phi [deg]", "valid", "runs")
_INTRO = (
    "The same grid of steady turns, driven once with each disturbance of the laser range finder, its mounting or its "
    "field, with the same random numbers. The evaluation knows of noise, quantisation and dropouts, but of no other "
    "error."
)
_CAPTION = (
    "Slip identified from the scans minus the true slip of the same runs. A disturbance level with the nominal row "
    "does no harm."
)
_NOTE = (
    "Pose errors are root mean squares over all runs. “valid” is the share of scans that gave a pose, “runs” the "
    "number of runs from which slip could be identified."
)
_LOOKS = {"outer": (BLUE, "o", -0.14), "inner": (ORANGE, "s", 0.14)}  # colour, marker, distance from the row's line
Rows = Sequence[Mapping[str, Any]]
"""As in summary.json."""


def page(rows: Rows, manifest: Mapping[str, Any], command: str) -> Page:
    """The figure and the table."""
    warnings = [f"{row['effect']}: {line}" for row in rows for line in row["warnings"]]
    seen = any(row["slip_error"] for row in rows)  # else there is nothing to scale the axis by
    plot = Plot("slip_errors", slip_errors(rows), "Error of slip over the runs", _CAPTION) if seen else None
    errors = Section("Errors of slip", [plot, table(rows), Bullets(warnings) if warnings else None])
    return Page("What scanner, mounting and field do to slip", command, manifest, [errors], [_INTRO])


def table(rows: Rows) -> Table:
    """One line per disturbance."""
    lines = []
    for row in rows:
        cells = [cell for track in _LOOKS for cell in _cells((row["slip_error"] or {}).get(track))]
        poses, runs = row["localization"], row["runs"]
        cells += [number(1e3 * poses[name], 1) for name in ("rmse_x", "rmse_y")]
        cells += [number(degrees(poses["rmse_heading"]), 2), f"{poses['valid_fraction']:.1%}"]
        lines.append((row["effect"], *cells, f"{runs['used']}/{runs['all']}"))
    return Table("Errors of slip over the runs, and of the poses (rms)", _HEADER, lines, note=_NOTE)


def _cells(errors: Mapping[str, float] | None) -> list[str]:
    if errors is None:
        return [MISSING] * 3
    bias = number(errors["bias"], 5)
    return [bias if errors["bias"] < 0 else f"+{bias}", number(errors["std"], 5), number(errors["largest"], 5)]


@styled
def slip_errors(rows: Rows) -> Figure:
    """Root mean square and largest error of slip over the runs, one line per row, on a logarithmic axis."""
    names = [row["effect"] if row["slip_error"] else f"{row['effect']}: no usable run" for row in rows]
    figure, axis = subplots(0.9 + 0.32 * len(rows), left=margin_for(names))
    for track, (colour, marker, beside) in _LOOKS.items():
        seen = [(k, row["slip_error"][track]) for k, row in enumerate(rows) if row["slip_error"]]
        place = np.array([k for k, _ in seen]) + beside
        typical = np.array([np.hypot(errors["bias"], errors["std"]) for _, errors in seen])
        largest = np.array([errors["largest"] for _, errors in seen])
        axis.hlines(place, typical, largest, color=colour, lw=1.2)
        axis.plot(typical, place, marker, ms=5, color=colour, label=f"{track} track, root mean square")
        axis.plot(largest, place, marker, ms=5, color=colour, mfc="white", label=f"{track} track, largest")
    axis.set_yticks(range(len(rows)), names)
    axis.set(xscale="log", ylim=(len(rows) - 0.5, -0.5), xlabel="error of slip [–], log scale")
    log_ticks(axis.xaxis)
    legend_below(figure, axis.get_legend_handles_labels()[0], ncols=4)
    return figure
