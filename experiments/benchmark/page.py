"""The page of a benchmark: the answer, which the terminal shows too, the leaderboard, all rows."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.benchmark.table import all_rows_table, board_table
from experiments.common.manifest import command_line, relative
from experiments.common.page import Answer, Bullets, Page, Plot, Section
from experiments.common.style import law_line, log_ticks, styled
from experiments.common.sweep import Row

_METHOD = (
    "Every controller drives every path on every ground, with each slip compensation. Plants, starts and scanner noise"
    " are the same for all. The position error is the distance between the robot's true position and the reference at"
    " the same time. A run keeps the path if this distance never exceeds 0.5 m."
)
_BOARD_CAPTION = (
    "Root mean square from 12 s on (for shorter runs, over the whole run), averaged over references and seeds. Lines"
    " span the best to the worst reference. Open symbols mark controllers that lost the path in at least one run."
)
_MARKERS = ("o", "s", "D", "^", "v", "P", "X", "<", ">", "p", "h", "*")
_PLACE = ("ground", "controller", "start", "compensation")
_ROW_HEIGHT = 0.4  # of a controller [in]
_MOST = 3  # entries that are as good as the best one and named
_LONGEST = 40  # name in a figure [characters]


def answer(entries: Sequence[Row], warnings: Sequence[str], next_command: str) -> Answer:
    """The first entry of the leaderboard and its error, its gain over no compensation, and its rivals."""
    best, *others = entries
    error = f"{_millimetres(best['score'])}{_interval(best['score_ci95'], 1e3)}"
    heading = f"Best: {_name(best, entries)}, {error} from the path"
    lines = []
    if best["gain"] is not None:
        gain = f"{best['gain']:.1f}{_interval(best['gain_ci95'])}"
        without = _millimetres(best["gain"] * best["score"])
        lines.append(f"Slip compensation divides its error by {gain}; without, it is {without}.")
    equal = [_name(entry, entries) for entry in others if entry["rank"] == 1]
    if equal:
        more = f" and {len(equal) - _MOST} more" if len(equal) > _MOST else ""
        lines.append(f"Not distinguishable from it: {', '.join(equal[:_MOST])}{more}.")
    elif others:
        behind = f"{_millimetres(others[0]['behind'])}{_interval(others[0]['behind_ci95'], 1e3)}"
        lines.append(f"Next: {_name(others[0], entries)}, {behind} behind.")
    losing = sum(entry["success"] < 1 for entry in entries)
    if losing:
        warnings = [*warnings, f"{losing} of {len(entries)} entries lose the path in some runs"]
    if best["score_ci95"] is None:
        warnings = [*warnings, "one seed tells no intervals: ranks are just the order of the errors"]
    return Answer(heading, lines=lines, warnings=warnings, next=[next_command])


def _name(entry: Row, entries: Sequence[Row]) -> str:
    """What is compared: controller, compensation and, where there are several, the start."""
    several = len({other["start"] for other in entries}) > 1
    start = f", start {entry['start']}" if several else ""
    return f"{relative(entry['controller'])} with {entry['compensation']}{start}"


def _millimetres(value: float) -> str:
    return f"{1e3 * value:.1f} mm"


def _interval(ends: Sequence[float] | None, scale: float = 1.0) -> str:
    return "" if ends is None else f" (95 %: {scale * ends[0]:.1f} to {scale * ends[1]:.1f})"


def page(
    answer: Answer,
    entries: Sequence[Row],
    rows: Sequence[Row],
    failures: Sequence[str],
    manifest: Mapping[str, Any],
) -> Page:
    """The page of these entries of the leaderboard, and means over seeds."""
    figure = board_figure(entries, rows)
    plot = Plot("leaderboard", figure, "Position error by controller and compensation", _BOARD_CAPTION)
    return Page(
        "Controllers of a tracked robot, with and without compensation of slip",
        command_line("benchmark"),
        manifest,
        [
            Section("Leaderboard", [plot, board_table(entries)]),
            Section("Failed runs", [Bullets(failures) if failures else None]),
            Section("All rows", [all_rows_table(rows)], folded=True),
            Section("How it is measured", [_METHOD], folded=True),
        ],
        answer=answer,
    )


@styled
def board_figure(entries: Sequence[Row], rows: Sequence[Row]) -> Figure:
    """Position error after the transient, by controller, the best first, and by ground (panels)."""
    grounds, compensations, starts = (
        list(dict.fromkeys(row[key] for row in rows)) for key in ("ground", "compensation", "start")
    )
    lines = list(dict.fromkeys((entry["controller"], entry["start"]) for entry in entries))
    figure = Figure(figsize=(9.0, 1.6 + _ROW_HEIGHT * len(lines)), layout="constrained")
    axes = figure.subplots(1, len(grounds), sharex=True, sharey=True, squeeze=False)[0]
    for axis, ground in zip(axes, grounds, strict=True):
        axis.set(title=f"on {relative(ground)}", xscale="log", xlabel="rms position error [mm], log scale")
        for k, compensation in enumerate(compensations):
            look = law_line(compensation, marker=_MARKERS[k % len(_MARKERS)], ms=5)
            axis.plot([], [], label=compensation, **look | {"linestyle": "none"})
            for n, line in enumerate(lines):
                place = (ground, *line, compensation)
                here = [row for row in rows if tuple(row[name] for name in _PLACE) == place]
                _mean_and_range(axis, here, n + 0.5 * ((k + 0.5) / len(compensations) - 0.5), look)
        log_ticks(axis.xaxis)
    names = [shortened(relative(name)) + (f", start {start}" if len(starts) > 1 else "") for name, start in lines]
    axes[0].set_yticks(range(len(lines)), names)
    axes[0].set_ylim(len(lines) - 0.5, -0.5)
    figure.legend(handles=axes[0].get_legend_handles_labels()[0], loc="outside lower center", ncols=5)
    return figure


def _mean_and_range(axis: Axes, rows: Sequence[Row], place: float, look: Mapping[str, Any]) -> None:
    """Draw the mean over rows, filled if none lost the path, and a line from the best row to the worst."""
    if rows:
        values = [1e3 * row["score"] for row in rows]
        fill = look["color"] if all(row["success"] == 1 for row in rows) else "white"
        axis.plot([min(values), max(values)], [place, place], color=look["color"], lw=1.0)
        axis.plot(np.mean(values), place, **look, mfc=fill)


def shortened(name: str) -> str:
    """A name for a figure, without the middle of a long list of arguments or a long path."""
    return name if len(name) <= _LONGEST else f"{name[: _LONGEST // 2]}…{name[-_LONGEST // 2 + 1 :]}"
