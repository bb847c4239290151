"""Figures of a benchmark: the leaderboard at a glance; paths and errors over time on a reference."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.benchmark.rows import settled_error
from experiments.driving.lookup import reference
from experiments.report.colours import BLACK, BLUE, GREEN, GREY, ORANGE, RED
from experiments.report.figures.style import law_line, legend_below, margin_for, styled, subplots
from experiments.report.figures.tracking import draw_paths
from experiments.report.laws import shown
from experiments.storage.manifest import relative
from experiments.sweep.parts import Row
from trackslip.logs.runlog import RunLog
from trackslip.metrics import LOST

_PALETTE = (BLUE, RED, GREEN, "#CC79A7", BLACK, ORANGE, "#3A93C9", "#6A3D9A", "#8C510A", GREY)
_DASHES: tuple[Any, ...] = ("-", "--", "-.", (0, (2, 1)), (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (3, 1, 1, 1)))
_PLACE = ("ground", "controller", "start", "compensation")
_MARKERS = ("o", "s", "D", "^", "v", "P", "X", "<", ">", "p", "h", "*")


def controller_line(number: int, **more: Any) -> dict[str, Any]:
    """Keywords of the `number`-th controller's line: colour and dashes; the first 70 are all different."""
    return {"color": _PALETTE[number % len(_PALETTE)], "linestyle": _DASHES[number % len(_DASHES)], **more}


def compensation_name(name: str) -> str:
    """Name of a compensation in figures."""
    return shown(relative(name)).title


@styled
def board(rows: Sequence[Row]) -> Figure:
    """Position error after the transient, by controller (rows) and ground (panels), on a logarithmic axis."""
    grounds, compensations, starts = (
        list(dict.fromkeys(row[key] for row in rows)) for key in ("ground", "compensation", "start")
    )
    lines = list(dict.fromkeys((row["controller"], row["start"]) for row in rows))
    labels = [relative(name) if len(starts) == 1 else f"{relative(name)}, start {start}" for name, start in lines]
    shared: dict[str, Any] = {"sharex": True, "sharey": True, "squeeze": False}
    figure, axes = subplots(1.2 + 0.42 * len(lines), 1, len(grounds), left=margin_for(labels), across=0.3, **shared)
    for axis, ground in zip(axes[0], grounds, strict=True):
        axis.set(title=f"on {relative(ground)}", xscale="log", xlabel="rms position error [mm], log scale")
        for k, compensation in enumerate(compensations):
            look = law_line(compensation, marker=_MARKERS[k % len(_MARKERS)], ms=5)
            axis.plot([], [], label=compensation_name(compensation), **look | {"linestyle": "none"})
            for n, line in enumerate(lines):
                wanted = (ground, *line, compensation)
                some = [row for row in rows if tuple(row[name] for name in _PLACE) == wanted]
                _mean_and_range(axis, some, n + 0.5 * ((k + 0.5) / len(compensations) - 0.5), look)
    axes[0, 0].set_yticks(range(len(lines)), labels)
    axes[0, 0].set_ylim(len(lines) - 0.5, -0.5)
    legend_below(figure, axes[0, 0].get_legend_handles_labels()[0], ncols=4)
    return figure


def _mean_and_range(axis: Axes, rows: Sequence[Row], place: float, look: Mapping[str, Any]) -> None:
    """Draw the mean over rows, filled if none lost the path, and a line from the best row to the worst."""
    values = [1e3 * value for row in rows if (value := settled_error(row)) < float("inf")]
    if values:
        fill = look["color"] if all(row["success"] == 1 for row in rows) else "white"
        axis.plot([min(values), max(values)], [place, place], color=look["color"], lw=1.0)
        axis.plot(np.mean(values), place, **look, mfc=fill)


@styled
def paths(name: str, lines: Mapping[str, tuple[RunLog, dict[str, Any]]]) -> Figure:
    """Paths on the reference `name`, and distances from it over time; `lines` are runs and line keywords by label."""
    figure, plane, distance = draw_paths(reference(name), lines)
    distance.axhline(1e3 * LOST, color=GREY, lw=0.8, ls=":")
    place = (0.99, 1e3 * LOST)
    distance.annotate("lost", place, xycoords=("axes fraction", "data"), ha="right", va="bottom", fontsize=8)
    legend_below(figure, plane.get_legend_handles_labels()[0], ncols=4)
    return figure
