"""The page of a sensitivity study: errors of slip side by side, and the table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.report.figures.style import BLUE, ORANGE, styled
from experiments.report.page import Drawing, Page, conditions, render_page

_LOOKS = {"outer": (BLUE, "o", -0.14), "inner": (ORANGE, "s", 0.14)}  # colour, marker, place beside the row's line


def render(
    rows: Sequence[Mapping[str, Any]],
    header: Sequence[str],
    table: Sequence[Sequence[str]],
    manifest: Mapping[str, Any],
    command: str,
) -> Page:
    """The page and its figure; `rows` as in the summary, `header` and `table` as printed."""
    drawing = Drawing("slip_errors", slip_errors(rows))
    html = render_page(
        "sensitivity.html.j2",
        title="What scanner, mounting and field do to slip",
        command=command,
        manifest=manifest,
        figures={drawing.name: drawing.inline},
        conditions=conditions(manifest, command),
        header=header,
        table=table,
        warnings=[(row["effect"], warning) for row in rows for warning in row["warnings"]],
    )
    return Page(html, [drawing])


@styled
def slip_errors(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Root mean square and largest error of slip over the runs, a line for each row, on a logarithmic axis."""
    figure = Figure(figsize=(9.0, 1.2 + 0.32 * len(rows)), layout="constrained")
    axis = figure.subplots()
    for track, (colour, marker, beside) in _LOOKS.items():
        seen = [(k, row["slip_error"][track]) for k, row in enumerate(rows) if row["slip_error"] is not None]
        place = np.array([k for k, _ in seen]) + beside
        typical = np.array([np.hypot(error["bias"], error["std"]) for _, error in seen])
        largest = np.array([error["largest"] for _, error in seen])
        axis.hlines(place, typical, largest, color=colour, lw=1.2)
        axis.plot(typical, place, marker, ms=5, color=colour, label=f"{track} track, root mean square")
        axis.plot(largest, place, marker, ms=5, color=colour, mfc="white", label=f"{track} track, largest")
    for k, row in enumerate(rows):
        if row["slip_error"] is None:
            axis.text(0.02, k, "no run can be used", transform=axis.get_yaxis_transform(), va="center", color="#666666")
    axis.set_xscale("log")
    axis.set_yticks(range(len(rows)), [row["effect"] for row in rows])
    axis.set_ylim(len(rows) - 0.5, -0.5)
    axis.set_xlabel("error of slip [-], logarithmic")
    figure.legend(handles=axis.get_legend_handles_labels()[0], ncols=4, loc="outside lower center")
    return figure
