"""A benchmark's output: answer and leaderboard, for the terminal and the page, and a page with all
rows.
"""

import math
import textwrap
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import cycle
from operator import itemgetter
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from experiments.benchmark.gains import ROUGHNESS_LIMIT
from experiments.benchmark.rows import SETTING
from experiments.common.manifest import command_line
from experiments.common.page import Answer, Bullets, Page, Plot, Section
from experiments.common.style import MARKERS, key, law_line, legend_below, log_ticks, panel, styled
from experiments.common.sweep import Row
from experiments.common.table import MISSING, Table, number
from sim.runs.stopwatch import StepTimes

_CAPTION: Final = (
    "Means over references, grounds and seeds, with 95 % intervals; runs that lose the path count "
    "500 mm."
)
# share of the time at the limits of the drives from which on a warning says so [-]
_MUCH_SATURATION: Final = 0.05
_NAME: Final = 22  # characters in a line of a name in the figure
_MOST_EQUAL: Final = 3  # largest number of entries named as indistinguishable from the best entry
_NUMBERS: Final = {  # column header: key in a row, factor from SI, decimals
    "kept [%]": ("success", 100.0, 0),
    "error [mm]": ("score", 1e3, 1),
    "improvement ×": ("gain", 1.0, 1),
    "turning [mm]": ("rms_position_arc", 1e3, 1),
    "heading [deg]": ("rms_heading", math.degrees(1), 2),
    "rough [rad/s²]": ("roughness", 1.0, 2),
}
_BEHIND: Final = "behind the best [mm]"
_OF_ROWS: Final = ("kept [%]", "error [mm]", "turning [mm]", "heading [deg]", "rough [rad/s²]")
_OF_BOARD: Final = ("error [mm]", "improvement ×", _BEHIND, "kept [%]")
_MORE: Final = ("turning [mm]", "heading [deg]", "rough [rad/s²]")
_BOARD_NOTE: Final = (
    "Entries of equal rank can't be distinguished from the first of them. Error: rms position "
    "error from 12 s on, 0.5 m for a run that lost it. Improvement: the error without compensation "
    "over this one. Behind: mean of the paired differences, with a 95 % bootstrap interval. Kept: "
    "runs that stayed within 0.5 m."
)
_MORE_NOTE: Final = (
    "Turning: error while the reference turns. Rough: rms rate of change of the set points; "
    f"! above {ROUGHNESS_LIMIT:g} rad/s², the limit of tune."
)
_BOARD: Final = "Position errors, means over references, grounds and seeds"
BOARD_LEGEND: Final = f"{_BOARD_NOTE} {_MORE_NOTE}"
"""Explanation of the leaderboard's columns."""


def answer(
    entries: Sequence[Row], next_command: str, steps: Mapping[str, StepTimes], period: float
) -> Answer:
    """The answer: the leaderboard's first entry with error, gain from compensation and closest
    rivals, and warnings.

    `steps` are the controllers' computing times, `period` is the time between two commands [s].
    """
    best = entries[0]
    alarms = []
    if best["success"] == 0:
        heading = "No entry keeps the path"
        alarms = [heading]
        lines = []
    else:
        heading = f"Best: {_full_name(best, entries)}: {_millimetres(best['score'])} rms"
        lines = [*_spread(best), *_gain(best), *_rivals(entries)]
    warnings = _warnings(entries, steps, period)
    return Answer(heading, (), lines, warnings, alarms, [next_command])


def _spread(best: Row) -> list[str]:
    """A line with the interval of the best entry's error, if it has one."""
    if best["score_ci95"] is None:
        return []
    interval = _interval(best["score_ci95"], 1e3, "").strip(" ()")
    return [f"95 % interval of its error: {interval} mm."]


def _gain(best: Row) -> list[str]:
    """A line on what compensation does for the best entry, if it compensates."""
    if best["gain"] is None:
        return []
    gain = f"{best['gain']:.1f}{_interval(best['gain_ci95'])}"
    without = _millimetres(best["gain"] * best["score"])
    return [f"Slip compensation divides its error by {gain}; without, it is {without}."]


def _rivals(entries: Sequence[Row]) -> list[str]:
    """A line on the entries that can't be distinguished from the best or, without any, the next."""
    others = entries[1:]
    equal = [_name(entry, entries) for entry in others if entry["rank"] == 1]
    if equal:
        named = ", ".join(equal[:_MOST_EQUAL])
        more = len(equal) - _MOST_EQUAL
        rest = f" and {more} more" if more > 0 else ""
        return [f"Not distinguishable from it: {named}{rest}."]
    if others:
        second = others[0]
        behind = _millimetres(second["behind"], second["behind_ci95"])
        return [f"Next: {_name(second, entries)}, {behind} behind."]
    return []


def _warnings(entries: Sequence[Row], steps: Mapping[str, StepTimes], period: float) -> list[str]:
    """Warnings on lost paths, drives at their limits, slow controllers and missing intervals."""
    warnings = []
    losing = sum(entry["success"] < 1 for entry in entries)
    if losing:
        warnings.append(f"{losing} of {len(entries)} entries lose the path in some runs")
    saturated = [entry for entry in entries if (entry["saturation"] or 0) >= _MUCH_SATURATION]
    if saturated:
        most = max(saturated, key=itemgetter("saturation"))
        warnings.append(
            f"set points at the top speed, or motors at their limits, for {_MUCH_SATURATION:.0%} "
            f"of the time or more in {len(saturated)} of {len(entries)} entries, at most for "
            f"{most['saturation']:.0%} in {_name(most, entries)}"
        )
    for name, times in steps.items():
        warning = times.warning(name, period)
        if warning is not None:
            warnings.append(warning)
    if entries[0]["score_ci95"] is None:
        warnings.append("there are no intervals with one seed: ranks are the order of the errors")
    return warnings


def _name(entry: Row, entries: Sequence[Row]) -> str:
    """The name of an entry: controller, compensation and, if there are several starts, the
    start.
    """
    start = f", start {entry['start']}" if _have_several_starts(entries) else ""
    return f"{entry['controller']} with {entry['compensation']}{start}"


def _full_name(entry: Row, entries: Sequence[Row]) -> str:
    """The name of an entry in words."""
    compensation = entry["compensation"] if entry["compensation"] != "none" else "no"
    start = f", start {entry['start']}" if _have_several_starts(entries) else ""
    return f"{entry['controller']} controller, {compensation} compensation{start}"


def _have_several_starts(entries: Sequence[Row]) -> bool:
    return len({entry["start"] for entry in entries}) > 1


def _millimetres(value: float, ends: Sequence[float] | None = None) -> str:
    return f"{1e3 * value:.1f} mm{_interval(ends, 1e3)}"


def _interval(ends: Sequence[float] | None, scale: float = 1.0, share: str = "95 %: ") -> str:
    if ends is None:
        return ""
    low, high = (round(scale * end, 1) + 0.0 for end in ends)  # avoids minus zero
    return f" ({share}{low:.1f} to {high:.1f})"


def board_table(entries: Sequence[Row]) -> Table:
    """The leaderboard as a table, with all its columns."""
    names = _entry_names(entries, "gains")
    return _table(_BOARD, entries, names, (*_OF_BOARD, *_MORE), BOARD_LEGEND)


def _entry_names(entries: Sequence[Row], *more: str) -> list[str]:
    """Columns that name an entry, and `more`."""
    names = ["rank", "controller", "compensation", *more]
    return [*names, "start"] if _have_several_starts(entries) else names


def _table(
    title: str, rows: Sequence[Row], names: Sequence[str], numbers: Sequence[str], note: str = ""
) -> Table:
    """A table with the columns `names`, as text, and `numbers`."""
    cells = []
    for row in rows:
        texts = [str(row[name]) for name in names]
        values = [_cell(row, header) for header in numbers]
        cells.append([*texts, *values])
    align = "l" * len(names) + "r"
    return Table(title, (*names, *numbers), cells, align=align, note=note)


def _cell(row: Row, header: str) -> str:
    if header == _BEHIND:
        return _behind(row)
    name, factor, digits = _NUMBERS[header]
    value = row[name]
    if value is None:
        return MISSING
    mark = "!" if name == "roughness" and value > ROUGHNESS_LIMIT else ""
    return mark + number(factor * value, digits)


def step_table(steps: Mapping[str, StepTimes]) -> Table:
    """Computing times of the control steps by controller."""
    header = ("controller", "median [ms]", "99 % [ms]", "worst [ms]")
    rows = []
    for name, times in steps.items():
        taken = (times.median, times.p99, times.worst)
        rows.append([name, *(number(1e3 * time, 2) for time in taken)])
    note = "Steps for one robot, with compensation and slip law, in the slowest run."
    return Table("Computing times of control steps", header, rows, align="lr", note=note)


def _behind(row: Row) -> str:
    """How far an entry is behind the best, with its interval; a dash for the best."""
    if row["behind"] == 0:
        return MISSING
    interval = _interval(row["behind_ci95"], 1e3, "")
    return f"{1e3 * row['behind']:.1f}{interval}"


def page(
    answer: Answer,
    entries: Sequence[Row],
    rows: Sequence[Row],
    failures: Sequence[str],
    steps: Mapping[str, StepTimes],
    manifest: Mapping[str, Any],
) -> Page:
    """The page, with the leaderboard's `entries`, with `rows` of means over seeds, and with the
    computing times of `steps` by controller.
    """
    plot = Plot(
        "leaderboard",
        partial(board_figure, entries),
        "Position error by controller and compensation",
        _CAPTION,
    )
    names = _entry_names(entries)
    leaderboard = _table(_BOARD, entries, names, _OF_BOARD, _BOARD_NOTE)
    more = _table("More numbers", entries, _entry_names(entries, "gains"), _MORE, _MORE_NOTE)
    all_rows = _table("Means over seeds", rows, SETTING, _OF_ROWS)
    return Page(
        title="Controllers of a tracked robot, with and without compensation of slip",
        command=command_line("benchmark"),
        manifest=manifest,
        sections=[
            Section("Leaderboard", [plot, leaderboard]),
            Section("Failed runs", [Bullets(failures) if failures else None]),
            Section("More numbers", [more], folded=True),
            Section("All rows", [all_rows], folded=True),
            Section("Computing times", [step_table(steps)], folded=True),
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
        for name, marker in zip(compensations, cycle(MARKERS), strict=False)
    }
    xlabel = "rms position error [mm], log scale"
    figure, axes = panel("", xlabel, "", 1.6 + 0.4 * len(lines))
    for entry in entries:
        look = looks[entry["compensation"]]
        # the compensations of a controller lie side by side within half of its line
        share = (compensations.index(entry["compensation"]) + 0.5) / len(compensations)
        line = lines.index((entry["controller"], entry["start"]))
        place = line + 0.5 * (share - 0.5)
        if entry["score_ci95"] is not None:
            ends = 1e3 * np.array(entry["score_ci95"])
            axes.plot(ends, [place, place], color=look["color"], lw=1.0)
        axes.plot(1e3 * entry["score"], place, ms=5, **look)
    axes.set_xscale("log")
    axes.set_ylim(len(lines) - 0.5, -0.5)
    log_ticks(axes.xaxis)

    names = [name for name, _ in lines]
    if _have_several_starts(entries):
        names = [f"{name}, start {start}" for name, start in lines]
    axes.set_yticks(range(len(lines)), [textwrap.fill(name, _NAME) for name in names])
    keys = [key(name, **look | {"linestyle": "none"}) for name, look in looks.items()]
    legend_below(figure, keys)
    return figure
