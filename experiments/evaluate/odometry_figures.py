"""Figures of odometry: estimated and measured paths, and errors over distance."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.common.colours import GREY
from experiments.common.style import (
    errors_ahead,
    key,
    law_line,
    legend_below,
    log_ticks,
    plane,
    styled,
    subplots,
    thin,
)
from experiments.evaluate.odometry import Evaluated
from trackslip.odometry.trajectory_errors import Trajectory

_POINTS = 1500  # poses drawn
_WIDTHS = (1.6, 2.6, 0.9)  # of the lines of laws with the same name [pt]


def longest(found: Sequence[Evaluated], law: int = 0) -> Trajectory:
    """The drive with the longest way, by one of the laws."""
    return max(found[law].errors.trajectories, key=lambda drive: drive.way[-1] - drive.way[0])


@styled
def paths(found: Sequence[Evaluated]) -> Figure:
    """The longest drive: paths from its first measured pose on the left, their errors over the way on the right."""
    figure, (left, right) = subplots(4.0, 1, 2)
    drive = longest(found)
    shown = thin(len(drive.time), _POINTS)
    left.plot(*drive.measured[shown, :2].T, ".", color=GREY, ms=4, mew=0)
    for k, look in enumerate(_looks(found)):
        drive = longest(found, k)
        left.plot(*drive.placed[shown, :2].T, **look)
        error = np.hypot(*(drive.placed - drive.measured)[shown, :2].T)
        right.plot((drive.way - drive.way[0])[shown], np.where(error > 0, error, np.nan), **look)
    plane(left, adjustable="datalim", title="Paths")
    right.set(xlabel="distance [m]", ylabel="error of position [m]", yscale="log")
    right.set_title("Error from the first pose on" if drive.has_heading else "Error, fitted to all positions")
    log_ticks(right.yaxis)
    _legend(figure, found, key("measured poses", ls="none", marker=".", ms=7, color=GREY))
    return figure


@styled
def errors_over_way(found: Sequence[Evaluated]) -> Figure:
    """Relative errors over the length of the stretches: of position, and of heading where it was measured."""
    kinds = [("Position", "mean error [% of the distance]", "position_per_way", 100.0)]
    kinds += [("Heading", "mean error [°/m]", "heading_per_way", np.degrees(1.0))]
    panels = []
    for title, label, kind, factor in kinds[: 1 + longest(found).has_heading]:
        errors = [[(at, factor * getattr(e, kind)) for at, e in one.errors.after_metres.items()] for one in found]
        panels.append((title, label, list(zip(errors, _looks(found), strict=True))))
    figure = errors_ahead(panels, [*found[0].errors.after_metres], "distance driven [m]")
    _legend(figure, found)
    return figure


def _looks(found: Sequence[Evaluated]) -> list[dict[str, Any]]:
    """Lines of the laws; laws with the same name differ in width."""
    names = [one.used.name for one in found]
    return [law_line(name, lw=_WIDTHS[names[:k].count(name) % len(_WIDTHS)]) for k, name in enumerate(names)]


def _legend(figure: Figure, found: Sequence[Evaluated], *first: Line2D) -> None:
    laws = [key(one.label, **look) for one, look in zip(found, _looks(found), strict=True)]
    legend_below(figure, [*first, *laws], handlelength=3.2)
