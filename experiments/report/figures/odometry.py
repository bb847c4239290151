"""Figures of odometry: paths beside the measured one, and errors over the way."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axis import YAxis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from experiments.odometry import Evaluated
from experiments.report.colours import GREY
from experiments.report.figures.style import law_line, legend_below, styled, subplots, thin
from trackslip.kinematics import Array
from trackslip.odometry.trajectory_errors import Trajectory

_POINTS = 1500  # poses drawn
_FEW_DECADES = 1e3  # largest over least, up to which decades are divided
_WIDTHS = (1.6, 2.6, 0.9)  # of the lines of laws with the same name [pt]


def longest(found: Sequence[Evaluated], law: int = 0) -> Trajectory:
    """The drive with the longest way, by one of the laws."""
    ways = [drive.way[-1] - drive.way[0] for drive in found[law].errors.trajectories]
    return found[law].errors.trajectories[int(np.argmax(ways))]


@styled
def paths(found: Sequence[Evaluated]) -> Figure:
    """The longest drive: paths from its first measured pose on the left, their errors over the way on the right."""
    figure, (left, right) = subplots(4.0, 1, 2)
    drive = longest(found)
    shown = thin(len(drive.time), _POINTS)
    left.plot(*drive.measured[shown, :2].T, ".", color=GREY, ms=4, mew=0)
    for k in range(len(found)):
        drive = longest(found, k)
        pose, way = drive.placed, drive.way - drive.way[0]
        left.plot(*pose[shown, :2].T, **_look(found, k))
        error = np.hypot(*(pose - drive.measured)[:, :2].T)
        right.plot(way[shown], _positive(error[shown]), **_look(found, k))
    left.set(aspect="equal", adjustable="datalim", xlabel="x [m]", ylabel="y [m]", title="Paths")
    right.set(xlabel="way [m]", ylabel="error of position [m]", title=_title(drive))
    right.set_yscale("log")
    _label(right.yaxis)
    measured = Line2D([], [], ls="none", marker=".", ms=7, color=GREY, label="measured poses")
    _legend(figure, found, [measured])
    return figure


@styled
def errors_over_way(found: Sequence[Evaluated]) -> Figure:
    """Relative errors over the length of the stretches: of position, and of heading where it was measured."""
    headings = longest(found).has_heading
    figure, axes = subplots(3.5, 1, 2 if headings else 1, squeeze=False)
    kinds = [("position_per_way", 100.0, "Position", "mean error [% of the way]")]
    if headings:
        kinds.append(("heading_per_way", np.degrees(1.0), "Heading", "mean error [°/m]"))
    for axis, (key, factor, title, label) in zip(axes[0], kinds, strict=True):
        lengths = np.array([*found[0].errors.after_metres])
        for k, one in enumerate(found):
            values = factor * np.array([getattr(errors, key) for errors in one.errors.after_metres.values()])
            axis.plot([*one.errors.after_metres], _positive(values), marker="o", ms=3.5, **_look(found, k))
        axis.set(title=title, xlabel="way driven [m]", ylabel=label, xscale="log", yscale="log")
        axis.set_xticks(lengths, [f"{length:g}" for length in lengths])
        axis.set_xticks([], minor=True)
        _label(axis.yaxis)
    _legend(figure, found, [])
    return figure


def _label(axis: YAxis) -> None:
    """Several labels on a logarithmic axis, of one decade or of many."""
    low, high = axis.get_view_interval()
    steps = (1.0, 2.0, 5.0) if high < _FEW_DECADES * low else (1.0,)
    axis.set_major_locator(LogLocator(subs=steps))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def _positive(values: Array) -> Array:
    """Values (n,) that a logarithmic axis can show; NaN for the others."""
    return np.where(values > 0, values, np.nan)


def _title(drive: Trajectory) -> str:
    return "Error from the first pose on" if drive.has_heading else "Error, fitted to all positions"


def _look(found: Sequence[Evaluated], law: int) -> dict[str, Any]:
    """Line of a law; laws with the same name differ in width."""
    before = sum(one.used.name == found[law].used.name for one in found[:law])
    return law_line(found[law].used.name, lw=_WIDTHS[before % len(_WIDTHS)])


def _legend(figure: Figure, found: Sequence[Evaluated], first: list[Line2D]) -> None:
    laws = [Line2D([], [], label=one.label, **_look(found, k)) for k, one in enumerate(found)]
    legend_below(figure, [*first, *laws], handlelength=3.2)
