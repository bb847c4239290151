"""The page on a sweep: slip over radius in each grid, its table, and what failed."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Any, Final

import numpy as np

from experiments.common.chart import Chart, Curve, law_curve
from experiments.common.colours import BLACK, BLUE, GREEN, GREY, ORANGE, RED, VERMILLION
from experiments.common.manifest import command_line
from experiments.common.page import Answer, Bullets, Page, Plot, Section
from experiments.common.sweep import Row
from experiments.common.table import percent, significant
from experiments.grid.drawbar import DrawbarTest, drawbar_charts
from experiments.grid.summary import RunGrid, failed, sweep_table, warnings_of
from trackslip.errors import counted
from trackslip.kinematics import Array
from trackslip.laws.exponential import PUBLISHED

_COLOURS: Final = (BLUE, ORANGE, GREEN, VERMILLION, "#CC79A7", "#6A3D9A", RED, "#56B4E9")
_DASHES: Final = ("-", "--", "-.")
_DRAWN: Final = 24  # largest number of grids that are drawn: colours times line styles
_LISTED: Final = 40  # largest number of warnings or failures that are listed
_CAPTION: Final = (
    "Means over the speeds at each radius, by the radius that was measured. Dashed: the published "
    "law, Eq. 11."
)

_DRAWBAR_CAPTION: Final = (
    "Marks: means over the last third of each run. Lines: theory of rigid tracks or wheels, "
    "straight ahead, as trackslip predict has it."
)


def page(
    grids: Sequence[RunGrid],
    rows: Sequence[Row],
    duration: float,
    out: Path,
    notes: Sequence[str],
    manifest: Mapping[str, Any],
    tests: Sequence[DrawbarTest] = (),
) -> Page:
    """The page on the grids of a sweep, whose runs have these rows and last `duration` [s], and the
    drawbar `tests` among them; `notes` are about the robot.
    """
    caption = _CAPTION
    if len(grids) > _DRAWN:
        caption += f" The first {_DRAWN} of {len(grids)} grids are drawn."
    slip = Plot("slip_over_radius", partial(slip_charts, grids), "Slip over radius", caption)
    radius = Plot(
        "driven_over_commanded",
        partial(radius_chart, grids),
        "Radius driven",
        "Slip widens the turns. Grey: without slip.",
    )
    failures = [f"{row['run']}: {row['error']}" for row in failed(rows)]
    sections = [
        _drawbar(tests),
        Section("Slip", [slip, sweep_table(grids, len(rows), duration), radius]),
        Section("Failed runs", [_bullets(failures)]),
        Section("Warnings", [_bullets(warnings_of(rows))], folded=True),
    ]
    title = "Slip of steady turns"
    shown = dict(manifest)
    axes = grids[0].axes
    if axes:
        title += f", by {', '.join(axes)}"
        shown.pop("ground", None)  # captions would give that of the options, which axes may replace
    if "seed" in axes:
        shown.pop("seed", None)
    answer = _answer(grids, rows, out, notes)
    facts = [test.answer for test in tests]
    answer = replace(answer, facts=[*facts, *answer.facts])
    return Page(title, command_line("grid"), shown, sections, answer=answer)


def _drawbar(tests: Sequence[DrawbarTest]) -> Section | None:
    """The section on drawbar tests; None without any."""
    if not tests:
        return None
    charts = partial(drawbar_charts, tests)
    plot = Plot("drawbar", charts, "Drawbar pull and slip", _DRAWBAR_CAPTION)
    return Section("Drawbar tests", [plot, *(test.table() for test in tests)])


def _bullets(lines: Sequence[str]) -> Bullets | None:
    """The first lines as a list; None if there are none."""
    if not lines:
        return None
    more = len(lines) - _LISTED
    rest = [f"and {more} more, in the run table"] if more > 0 else []
    return Bullets([*lines[:_LISTED], *rest])


def _answer(
    grids: Sequence[RunGrid], rows: Sequence[Row], out: Path, notes: Sequence[str]
) -> Answer:
    """The answer: the range of the slips, and how well they were measured."""
    broken = len(failed(rows))
    runs = counted(len(rows) - broken, "run")
    heading = runs if len(grids) == 1 else f"{runs} in {counted(len(grids), 'grid')}"
    facts = []
    for name in ("inner", "outer"):
        slips = np.concatenate([getattr(grid.slip_by_radius, name) for grid in grids])
        facts.append((f"slip of the {name} track", _range(slips)))
    ratio = np.concatenate([grid.radius.observed / grid.radius.commanded for grid in grids])
    facts.append(("radius driven over commanded", _range(ratio, 1.0, 2)))
    errors = [error for grid in grids for error in (grid.slip_error.outer, grid.slip_error.inner)]
    mean_squares = np.array([error.bias**2 + error.std**2 for error in errors])
    known = mean_squares[np.isfinite(mean_squares)]
    if known.size:
        error = float(np.sqrt(known.mean()))
        facts.append(("slip measured minus true", f"{significant(error)} rms"))
    alarms = []
    unmeasured = sum(row["error"] is None and row.get("slip_l") is None for row in rows)
    if unmeasured == len(rows) - broken:
        alarms.append("No run gave a slip")
    warnings = []
    if broken:
        warnings.append(f"{counted(broken, 'run')} of {len(rows)} failed")
    if unmeasured:
        warnings.append(f"{counted(unmeasured, 'run')} of {len(rows)} gave no slip")
    noted = len(warnings_of(rows))
    if noted:
        warnings.append(f"{counted(noted, 'warning')}, listed below")
    lines = [f"{note[0].upper()}{note[1:]}." for note in notes]
    following = [] if alarms else [f"trackslip identify {shlex.quote(str(out))}"]
    return Answer(heading, facts, lines, warnings, alarms, following)


def _range(values: Array, factor: float = 100.0, digits: int = 1) -> str:
    """The least and the greatest of the known values (n,), by default in per cent."""
    known = factor * values[np.isfinite(values)]
    if not known.size:
        return percent(None)
    unit = " %" if factor == 100.0 else ""
    low, high = (f"{value:.{digits}f}".replace("-", "−") for value in (known.min(), known.max()))
    return f"{low}{unit}" if low == high else f"{low} to {high}{unit}"


def slip_charts(grids: Sequence[RunGrid]) -> list[Chart] | None:
    """Mean slip of the inner and the outer track over the measured radius, a curve per grid; None
    if no run gave a slip.
    """
    radii = np.concatenate([grid.radius.observed for grid in grids])
    known = np.abs(radii[np.isfinite(radii)])
    if not known.size:
        return None
    radius = np.linspace(0.9 * known.min(), 1.05 * known.max(), 100)
    published = PUBLISHED(1 / radius)  # left turns: the left track is the inner one
    charts = []
    for column, name in enumerate(("inner", "outer")):
        law = law_curve(radius, published[:, column], "published", width=1.2)
        curves = [
            _curve(grid.radius.observed, getattr(grid.slip_by_radius, name), *look)
            for grid, look in _looks(grids)
        ]
        chart = Chart(
            f"{name.capitalize()} track",
            "measured radius [m]",
            "slip [–]",
            [law, *curves],
            has_zero=True,
        )
        charts.append(chart)
    return charts


def radius_chart(grids: Sequence[RunGrid]) -> Chart | None:
    """Driven over commanded radius, a curve per grid; None if no run gave a radius."""
    curves = []
    most = 0.0
    for grid, look in _looks(grids):
        commanded = np.array(grid.radius.commanded)
        if np.isfinite(grid.radius.observed).any():
            most = max(most, float(commanded.max()))
            curves.append(_curve(commanded, grid.radius.observed, *look))
    if not curves:
        return None
    equal = Curve(np.array([0.0, most]), np.array([0.0, most]), "without slip", GREY, 1.0)
    return Chart("", "radius commanded [m]", "radius driven [m]", [equal, *curves])


def _looks(grids: Sequence[RunGrid]) -> list[tuple[RunGrid, tuple[str, str, str]]]:
    """The grids that are drawn, with label, colour and line style."""
    if len(grids) == 1:
        return [(grids[0], ("measured", BLACK, "-"))]
    looks = []
    colours = cycle(_COLOURS)
    for k, grid in enumerate(grids[:_DRAWN]):
        label = " ".join(f"{axis}={value}" for axis, value in grid.axes.items())
        looks.append((grid, (label, next(colours), _DASHES[k // len(_COLOURS)])))
    return looks


def _curve(x: Array, y: Array, label: str, colour: str, dashes: str) -> Curve:
    """A curve with marks through known points, in the order of their horizontal places."""
    order = np.argsort(x)
    return Curve(x[order], y[order], label, colour, 1.2, dashes, "o", 5.0)
