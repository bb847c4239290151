"""What a benchmark shows: the answer and the leaderboard, which the terminal shows too, and a page with all rows."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.benchmark.cases import FACTORS
from experiments.benchmark.rows import ENTRY
from experiments.common.manifest import command_line, relative
from experiments.common.page import Answer, Bullets, Page, Plot, Section
from experiments.common.style import law_line, log_ticks, styled
from experiments.common.sweep import Row
from experiments.common.table import MISSING, Table, number

_BOARD_CAPTION = (
    "Root mean square from 12 s on (for shorter runs, over the whole run), averaged over references and seeds. Lines"
    " span the best to the worst reference. Open symbols mark controllers that lost the path in at least one run."
)
_MARKERS = ("o", "s", "D", "^", "v", "P", "X", "<", ">", "p", "h", "*")
_PLACE = ("ground", "controller", "start", "compensation")
_ROW_HEIGHT = 0.4  # of a controller [in]
_MOST = 3  # entries that are as good as the best one and named
_LONGEST = 40  # name in a figure [characters]
_NUMBERS = {  # header of a column: its name in a row, factor from SI, decimals
    "kept [%]": ("success", 100.0, 0),
    "error [mm]": ("score", 1e3, 1),
    "gain": ("gain", 1.0, 1),
    "turning [mm]": ("rms_position_arc", 1e3, 1),
    "heading [deg]": ("rms_heading", math.degrees(1), 2),
    "across [mm]": ("cross_track", 1e3, 1),
    "along [mm]": ("along_track", 1e3, 1),
    "max [mm]": ("max_position", 1e3, 1),
    "effort [rad²/s]": ("effort", 1.0, 0),
    "rough [rad/s²]": ("roughness", 1.0, 2),
    "step [ms]": ("compute_ms_p50", 1.0, 2),
}
BOARD_LEGEND = (
    "Plants, starts and noise are the same for all. Entries of equal rank can't be distinguished from the first of"
    " them. Kept: runs that stayed within 0.5 m. Error: rms position error from 12 s on, 0.5 m for a run that lost it."
    " Gain: the error without compensation over this one. Behind: mean of the paired differences from the best entry,"
    " with a 95 % bootstrap interval. Turning: error while the reference turns. Rough: rms rate of change of the set"
    " points. Step: median computing time of a control step, compensation included."
)
"""What the columns of the leaderboard are."""


def answer(entries: Sequence[Row], next_command: str) -> Answer:
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
    if best["success"] == 0:
        heading, lines = "No entry keeps the path", []
    warnings = []
    losing = sum(entry["success"] < 1 for entry in entries)
    if losing:
        warnings.append(f"{losing} of {len(entries)} entries lose the path in some runs")
    if best["score_ci95"] is None:
        warnings.append("one seed tells no intervals: ranks are just the order of the errors")
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


def board_table(entries: Sequence[Row]) -> Table:
    """The leaderboard."""
    names = ENTRY if len({entry["start"] for entry in entries}) > 1 else ENTRY[:2]
    before, after = ("kept [%]", "error [mm]", "gain"), ("turning [mm]", "heading [deg]", "rough [rad/s²]", "step [ms]")
    return Table(
        "Position errors, means over references, grounds and seeds",
        ("rank", *names, *before, "behind the best [mm]", *after),
        [
            [str(entry["rank"]), *_texts(entry, names), *_cells(entry, before), _behind(entry), *_cells(entry, after)]
            for entry in entries
        ],
        align=f"l{'l' * len(names)}r",
        note=BOARD_LEGEND,
    )


def all_rows_table(rows: Sequence[Row]) -> Table:
    """All rows."""
    names, numbers = FACTORS[:-1], [header for header in _NUMBERS if header != "gain"]
    return Table(
        "Means over seeds",
        (*names, *numbers),
        [[*_texts(row, names), *_cells(row, numbers)] for row in rows],
        align="lllllr",
        note="“across” and “along” are root mean squares relative to the reference's direction; effort is the integral"
        " of the mean square of both sprockets' set points. summary.json has 95 % intervals and every run.",
    )


def _texts(row: Row, names: Iterable[str]) -> list[str]:
    return [relative(row[name]) for name in names]


def _cells(row: Row, headers: Iterable[str]) -> list[str]:
    columns = [_NUMBERS[header] for header in headers]
    return [number(None if row[name] is None else factor * row[name], digits) for name, factor, digits in columns]


def _behind(entry: Row) -> str:
    """The difference from the best entry and its interval."""
    if entry["behind"] == 0:
        return MISSING
    behind = f"{1e3 * entry['behind']:.1f}"
    if entry["behind_ci95"] is None:
        return behind
    low, high = (round(1e3 * end, 1) + 0.0 for end in entry["behind_ci95"])  # no minus zero
    return f"{behind} ({low:.1f} to {high:.1f})"


def leaderboard(entries: Sequence[Row], about: Mapping[str, Any]) -> str:
    """The leaderboard in Markdown; `about` is the manifest."""
    git, versions = about["git"] or {}, about["versions"]
    changed = " with uncommitted changes" if git.get("dirty") else ""
    installed = ", ".join(f"{name} {version}" for name, version in versions.items() if version)
    table = board_table(entries)
    bar = [":--" if side == "l" else "--:" for side in table.sides]
    lines = [f"| {' | '.join(line)} |" for line in (table.header, bar, *table.texts)]
    suite = f"Suite `{about['config']['suite']}`, commit {git.get('commit', 'unknown')}{changed}, {installed}."
    return "\n\n".join(["# Leaderboard", suite, "\n".join(lines), BOARD_LEGEND]) + "\n"


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
