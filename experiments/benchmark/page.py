"""The page of a benchmark: leaderboard, lost paths, paths, all rows; and its figures."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.benchmark.cases import BenchmarkCase
from experiments.benchmark.rows import settled_error
from experiments.benchmark.table import board_table, whole_table
from experiments.common.colours import BLACK, BLUE, GREEN, GREY, ORANGE, RED
from experiments.common.laws import shown
from experiments.common.lookup import reference
from experiments.common.manifest import command_line, relative
from experiments.common.page import Bullets, Page, Plot, Section, file_name
from experiments.common.style import law_line, legend_below, log_ticks, margin_for, styled, subplots
from experiments.common.sweep import Row
from experiments.simulate.tracking_figures import draw_paths
from trackslip.logs.logfile import StoredRuns
from trackslip.logs.runlog import RunLog
from trackslip.metrics import LOST

_FAVOURITES = ("icr_radius", "online", "icr", "published", "none")  # compensations to compare controllers with
_REPRESENTATIVES = ("linear", "feedforward")  # controllers to compare compensations with
_INTRO = (
    "Every controller drives every path on every ground, with each slip compensation. Plants, starts and scanner noise"
    " are the same for all. The position error is the distance between the robot's true position and the reference at"
    " the same time. A run keeps the path if this distance never exceeds 0.5 m."
)
_BOARD_CAPTION = (
    "Root mean square from 12 s on (for shorter runs, over the whole run), averaged over references and seeds. Lines"
    " span the best to the worst reference. Open symbols mark controllers that lost the path in at least one run."
)
_PALETTE = (BLUE, RED, GREEN, "#CC79A7", BLACK, ORANGE, "#3A93C9", "#6A3D9A", "#8C510A", GREY)
_DASHES: tuple[Any, ...] = ("-", "--", "-.", (0, (2, 1)), (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (3, 1, 1, 1)))
_PLACE = ("ground", "controller", "start", "compensation")
_LONGEST = 40  # name in a figure [characters]
_MARKERS = ("o", "s", "D", "^", "v", "P", "X", "<", ">", "p", "h", "*")


def page(
    runs_file: Path,
    entries: Sequence[Row],
    lost: Sequence[str],
    rows: Sequence[Row],
    driven: Sequence[BenchmarkCase],
    manifest: Mapping[str, Any],
) -> Page:
    """The page, with figures of the cases `driven`, whose logs are in the Parquet file `runs_file`."""
    heading = "Position error by controller, compensation and ground"
    plot = Plot("leaderboard", board_figure(rows), heading, _BOARD_CAPTION)
    return Page(
        "Controllers of a tracked robot, with and without compensation of slip",
        command_line("benchmark"),
        manifest,
        [
            Section("Leaderboard", [plot, board_table(entries), Section("Lost paths", [Bullets(lost)])]),
            Section("Paths", list(_path_plots(runs_file, driven))),
            Section("All rows", [whole_table(rows)]),
        ],
        intro=[_INTRO],
    )


def _path_plots(runs_file: Path, cases: Sequence[BenchmarkCase]) -> Iterator[Plot]:
    """Per reference: controllers side by side, and one controller with each compensation; first ground and seed."""
    for name in dict.fromkeys(case.reference for case in cases):
        first = next(case for case in cases if case.reference == name)
        here = [case for case in cases if (case.reference, case.ground, case.seed) == (name, first.ground, first.seed)]
        controllers = list(dict.fromkeys(case.controller for case in here))
        laws = list(dict.fromkeys(case.compensation for case in here))
        if len(controllers) > 1:
            favourite = next(law for law in (*_FAVOURITES, *laws) if law in laws)
            same = [case for case in here if case.compensation == favourite]
            chosen = {case.controller: case for case in same if case.start == same[0].start}
            looks = {key: controller_line(k) for k, key in enumerate(controllers)}
            what = f"All with {compensation_name(favourite)}, on"
            yield _plot(runs_file, chosen, looks, f"{relative(name)}: controllers", what)
        if len(laws) > 1:
            preferred = [one for one in _REPRESENTATIVES if one in controllers]
            for controller in list(dict.fromkeys([*preferred, *controllers]))[:2]:
                same = [case for case in here if case.controller == controller]
                chosen = {case.compensation: case for case in same if case.start == same[0].start}
                heading = f"{relative(name)}: {_shortened(relative(controller))} with each compensation"
                yield _plot(runs_file, chosen, {law: law_line(law) for law in chosen}, heading, "On")


def _plot(
    runs_file: Path,
    chosen: Mapping[str, BenchmarkCase],
    looks: Mapping[str, Mapping[str, Any]],
    heading: str,
    what: str,
) -> Plot:
    runs, one = StoredRuns(runs_file), next(iter(chosen.values()))
    lines = {compensation_name(key): (runs.log(case.name), dict(looks[key])) for key, case in chosen.items()}
    caption = f"{what} {relative(one.ground)}, start {one.start}, seed {one.seed}."
    return Plot(f"paths_{file_name(heading)}", paths_figure(one.reference, lines), heading, caption)


def controller_line(number: int) -> dict[str, Any]:
    """Colour and dashes of the `number`-th controller's line; the first 70 are all different."""
    return {"color": _PALETTE[number % len(_PALETTE)], "linestyle": _DASHES[number % len(_DASHES)]}


def compensation_name(name: str) -> str:
    """Name of a compensation in figures."""
    return shown(relative(name)).label


@styled
def board_figure(rows: Sequence[Row]) -> Figure:
    """Position error after the transient, by controller (rows) and ground (panels), on a logarithmic axis."""
    grounds, compensations, starts = (
        list(dict.fromkeys(row[key] for row in rows)) for key in ("ground", "compensation", "start")
    )
    lines = list(dict.fromkeys((row["controller"], row["start"]) for row in rows))
    names = [relative(name) if len(starts) == 1 else f"{relative(name)}, start {start}" for name, start in lines]
    labels = [_shortened(name) for name in names]
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
        log_ticks(axis.xaxis)
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
def paths_figure(name: str, lines: Mapping[str, tuple[RunLog, dict[str, Any]]]) -> Figure:
    """Paths on the reference `name`, and distances from it over time; `lines` are runs and line keywords by label."""
    figure, plane, distance = draw_paths(reference(name), lines)
    distance.axhline(1e3 * LOST, color=GREY, lw=0.8, ls=":")
    place = (0.99, 1e3 * LOST)
    distance.annotate("lost", place, xycoords=("axes fraction", "data"), ha="right", va="bottom", fontsize=8)
    handles = plane.get_legend_handles_labels()[0]
    for handle in handles:
        handle.set_label(_shortened(str(handle.get_label())))
    legend_below(figure, handles, ncols=4)
    return figure


def _shortened(name: str) -> str:
    """A name for a figure, without the middle of a long list of arguments or a long path."""
    return name if len(name) <= _LONGEST else f"{name[: _LONGEST // 2]}…{name[-_LONGEST // 2 + 1 :]}"
