"""A benchmark's output: answer and leaderboard, for the terminal and the page, and a page with all
rows.
"""

import math
import textwrap
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.benchmark.gains import ROUGHNESS_LIMIT
from experiments.benchmark.rows import ENTRY, SETTING
from experiments.common.manifest import command_line
from experiments.common.page import Answer, Bullets, Page, Plot, Section
from experiments.common.style import key, law_line, log_ticks, styled
from experiments.common.sweep import Row
from experiments.common.table import MISSING, Table, number

_CAPTION = (
    "Means over references, grounds and seeds, with 95 % intervals; runs that lose the "
    "path count 500 mm."
)
_MARKERS = ("o", "s", "D", "^", "v", "P", "X", "<", ">", "p", "h", "*")
_MOST = 3  # largest number of entries named as indistinguishable from the best entry
_NUMBERS = {  # column header: key in a row, factor from SI, decimals
    "kept [%]": ("success", 100.0, 0),
    "error [mm]": ("score", 1e3, 1),
    "gain": ("gain", 1.0, 1),
    "turning [mm]": ("rms_position_arc", 1e3, 1),
    "heading [deg]": ("rms_heading", math.degrees(1), 2),
    "rough [rad/s²]": ("roughness", 1.0, 2),
}
_BEHIND = "behind the best [mm]"
_OF_ROWS = ("kept [%]", "error [mm]", "turning [mm]", "heading [deg]", "rough [rad/s²]")
_OF_ENTRIES = (*_OF_ROWS[:2], "gain", _BEHIND, *_OF_ROWS[2:])
BOARD_LEGEND = (
    "Entries of equal rank can't be distinguished from the first of them. Kept: runs that stayed "
    "within 0.5 m. Error:"
    " rms position error from 12 s on, 0.5 m for a run that lost it. Gain: the error without "
    "compensation over this"
    " one. Behind: mean of the paired differences, with a 95 % bootstrap interval. Turning: "
    "error while the reference"
    f" turns. Rough: rms rate of change of the set points; ! above {ROUGHNESS_LIMIT:g} rad/s², "
    "the limit of tune."
)
"""Explanation of the leaderboard's columns."""


def answer(
    entries: Sequence[Row], next_command: str, steps: Mapping[str, float], period: float
) -> Answer:
    """The answer: the leaderboard's first entry with error, gain from compensation and closest
    rivals, and warnings.

    `steps` are the controllers' computing times per step, `period` is the time between two commands
    [s].
    """
    best, *others = entries
    heading = (
        f"Best: {_name(best, entries)}, {_millimetres(best['score'], best['score_ci95'])} "
        "from the path"
    )
    lines = []
    if best["gain"] is not None:
        gain, without = (
            f"{best['gain']:.1f}{_interval(best['gain_ci95'])}",
            _millimetres(best["gain"] * best["score"]),
        )
        lines.append(f"Slip compensation divides its error by {gain}; without, it is {without}.")
    equal = [_name(entry, entries) for entry in others if entry["rank"] == 1]
    if equal:
        more = f" and {len(equal) - _MOST} more" if len(equal) > _MOST else ""
        lines.append(f"Not distinguishable from it: {', '.join(equal[:_MOST])}{more}.")
    elif others:
        behind = _millimetres(others[0]["behind"], others[0]["behind_ci95"])
        lines.append(f"Next: {_name(others[0], entries)}, {behind} behind.")
    if best["success"] == 0:
        heading, lines = "No entry keeps the path", []
    warnings = []
    losing = sum(entry["success"] < 1 for entry in entries)
    if losing:
        warnings.append(f"{losing} of {len(entries)} entries lose the path in some runs")
    warnings += [
        f"{name} takes {1e3 * step:.0f} ms a step for one robot, but commands are due every "
        f"{1e3 * period:.0f} ms"
        for name, step in steps.items()
        if step > period
    ]
    if best["score_ci95"] is None:
        warnings.append("there are no intervals with one seed: ranks are the order of the errors")
    return Answer(heading, lines=lines, warnings=warnings, next=[next_command])


def _name(entry: Row, entries: Sequence[Row]) -> str:
    """The name of an entry: controller, compensation and, if there are several starts, the
    start.
    """
    several = len({other["start"] for other in entries}) > 1
    start = f", start {entry['start']}" if several else ""
    return f"{entry['controller']} with {entry['compensation']}{start}"


def _millimetres(value: float, ends: Sequence[float] | None = None) -> str:
    return f"{1e3 * value:.1f} mm{_interval(ends, 1e3)}"


def _interval(ends: Sequence[float] | None, scale: float = 1.0, share: str = "95 %: ") -> str:
    if ends is None:
        return ""
    low, high = (round(scale * end, 1) + 0.0 for end in ends)  # avoids minus zero
    return f" ({share}{low:.1f} to {high:.1f})"


def board_table(entries: Sequence[Row]) -> Table:
    """The leaderboard as a table."""
    starts = ENTRY[2:] if len({entry["start"] for entry in entries}) > 1 else ()
    names = (*ENTRY[:2], "gains", *starts)
    title = "Position errors, means over references, grounds and seeds"
    return _table(title, entries, ("rank", *names), _OF_ENTRIES, BOARD_LEGEND)


def _table(
    title: str, rows: Sequence[Row], names: Sequence[str], numbers: Sequence[str], note: str = ""
) -> Table:
    cells = [
        [*(str(row[name]) for name in names), *(_cell(row, header) for header in numbers)]
        for row in rows
    ]
    return Table(title, (*names, *numbers), cells, align="l" * len(names) + "r", note=note)


def _cell(row: Row, header: str) -> str:
    if header == _BEHIND:
        return (
            MISSING
            if row["behind"] == 0
            else f"{1e3 * row['behind']:.1f}{_interval(row['behind_ci95'], 1e3, '')}"
        )
    name, factor, digits = _NUMBERS[header]
    mark = "!" if name == "roughness" and (row[name] or 0.0) > ROUGHNESS_LIMIT else ""
    return mark + number(None if row[name] is None else factor * row[name], digits)


def page(
    answer: Answer,
    entries: Sequence[Row],
    rows: Sequence[Row],
    failures: Sequence[str],
    manifest: Mapping[str, Any],
) -> Page:
    """The page, with the leaderboard's `entries` and with `rows` of means over seeds."""
    plot = Plot(
        "leaderboard",
        board_figure(entries),
        "Position error by controller and compensation",
        _CAPTION,
    )
    return Page(
        "Controllers of a tracked robot, with and without compensation of slip",
        command_line("benchmark"),
        manifest,
        [
            Section("Leaderboard", [plot, board_table(entries)]),
            Section("Failed runs", [Bullets(failures) if failures else None]),
            Section("All rows", [_table("Means over seeds", rows, SETTING, _OF_ROWS)], folded=True),
        ],
        answer=answer,
    )


@styled
def board_figure(entries: Sequence[Row]) -> Figure:
    """Position errors with their 95 % intervals by controller, the best controller first."""
    lines = list(dict.fromkeys((entry["controller"], entry["start"]) for entry in entries))
    compensations = sorted({entry["compensation"] for entry in entries})
    looks = {
        name: law_line(name, marker=marker)
        for name, marker in zip(compensations, cycle(_MARKERS), strict=False)
    }
    figure = Figure(figsize=(8.0, 1.6 + 0.4 * len(lines)), layout="constrained")
    axes = figure.subplots()
    for entry in entries:
        look, error = looks[entry["compensation"]], 1e3 * entry["score"]
        offset = (compensations.index(entry["compensation"]) + 0.5) / len(compensations) - 0.5
        place = lines.index((entry["controller"], entry["start"])) + 0.5 * offset
        if entry["score_ci95"] is not None:
            axes.plot(
                1e3 * np.array(entry["score_ci95"]), [place, place], color=look["color"], lw=1.0
            )
        axes.plot(error, place, ms=5, **look)
    axes.set(
        xscale="log", xlabel="rms position error [mm], log scale", ylim=(len(lines) - 0.5, -0.5)
    )
    log_ticks(axes.xaxis)
    several = len({start for _, start in lines}) > 1
    names = [name + (f", start {start}" if several else "") for name, start in lines]
    axes.set_yticks(range(len(lines)), [textwrap.fill(name, 40) for name in names])
    keys = [key(name, **look | {"linestyle": "none"}) for name, look in looks.items()]
    figure.legend(handles=keys, loc="outside lower center", ncols=5)
    return figure
