"""The page of a sensitivity study: slip errors under each disturbance, as a figure and as a table."""

from collections.abc import Mapping, Sequence
from math import degrees
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.measuring.sensitivity import SensitivityRow, SlipErrors
from experiments.report.colours import BLUE, ORANGE
from experiments.report.figures.style import legend_below, margin_for, styled, subplots
from experiments.report.formats import MISSING, number
from experiments.report.template_page import Drawing, Page, render_page

_OF_SLIP = ("", "outer bias", "std", "largest", "inner bias", "std", "largest")
HEADER = (*_OF_SLIP, "x [mm]", "y [mm]", "phi [deg]", "valid", "runs")
_LOOKS = {"outer": (BLUE, "o", -0.14), "inner": (ORANGE, "s", 0.14)}  # colour, marker, distance from the row's line


def render(rows: Sequence[SensitivityRow], manifest: Mapping[str, Any], command: str) -> Page:
    """Draw the figure and fill in the template."""
    return render_page(
        "sensitivity.html.j2",
        [Drawing("slip_errors", slip_errors(rows))],
        title="What scanner, mounting and field do to slip",
        command=command,
        manifest=manifest,
        header=HEADER,
        table=table(rows),
        warnings=[(row.effect, warning) for row in rows for warning in row.warnings],
    )


def table(rows: Sequence[SensitivityRow]) -> list[tuple[str, ...]]:
    """One line per disturbance, under HEADER."""
    lines = []
    for row in rows:
        slip, errors = row.slip_error, row.localization
        cells = [MISSING] * 6 if slip is None else _cells(slip.outer) + _cells(slip.inner)
        pose = number(1e3 * errors.rmse_x, 1), number(1e3 * errors.rmse_y, 1), number(degrees(errors.rmse_heading), 2)
        lines.append((row.effect, *cells, *pose, f"{errors.valid_fraction:.1%}", f"{row.runs.used}/{row.runs.all}"))
    return lines


def _cells(errors: SlipErrors) -> list[str]:
    bias = number(errors.bias, 5)
    return [bias if errors.bias < 0 else f"+{bias}", number(errors.std, 5), number(errors.largest, 5)]


@styled
def slip_errors(rows: Sequence[SensitivityRow]) -> Figure:
    """Root mean square and largest error of slip over the runs, one line per row, on a logarithmic axis."""
    figure, axis = subplots(0.9 + 0.32 * len(rows), left=margin_for([row.effect for row in rows]))
    for track, (colour, marker, beside) in _LOOKS.items():
        seen = [(k, getattr(row.slip_error, track)) for k, row in enumerate(rows) if row.slip_error is not None]
        place = np.array([k for k, _ in seen]) + beside
        typical = np.array([np.hypot(error.bias, error.std) for _, error in seen])
        largest = np.array([error.largest for _, error in seen])
        axis.hlines(place, typical, largest, color=colour, lw=1.2)
        axis.plot(typical, place, marker, ms=5, color=colour, label=f"{track} track, root mean square")
        axis.plot(largest, place, marker, ms=5, color=colour, mfc="white", label=f"{track} track, largest")
    for k, row in enumerate(rows):
        if row.slip_error is None:
            axis.text(0.02, k, "no usable run", transform=axis.get_yaxis_transform(), va="center", color="#666666")
    axis.set_yticks(range(len(rows)), [row.effect for row in rows])
    axis.set(xscale="log", ylim=(len(rows) - 0.5, -0.5), xlabel="error of slip [-], logarithmic")
    legend_below(figure, axis.get_legend_handles_labels()[0], ncols=4)
    return figure
