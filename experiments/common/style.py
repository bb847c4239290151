"""The look of all figures: one colour and one line style per slip law everywhere."""

import itertools
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.ticker import LogLocator, NullFormatter

from experiments.common.colours import BLACK, BLUE, GREY, ORANGE, RED, SHADE
from experiments.common.laws import shown
from trackslip.kinematics import Array

INNER, OUTER = ORANGE, BLUE  # tracks
BAND = "#d5e6d5"  # background of values too small to matter
STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.7,
    "lines.linewidth": 1.5,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
}
RADII_SHADES, SPEED_SHADES = ("viridis", 0.6), ("plasma", 0.6)  # colour maps, and the share dark enough to be seen
_EDGES = [withStroke(linewidth=5.2, foreground=GREY)]
DESIRED: dict[str, Any] = {"color": "#e3e3e3", "lw": 3.6, "solid_capstyle": "round", "path_effects": _EDGES}
"""Look of the line of a reference, drawn like a road."""
RECIPE: dict[str, Any] = {"color": BLUE, "marker": "o"}  # the model's contacts in the figures of a validation
DEFAULT: dict[str, Any] = {"color": RED, "marker": "^"}  # MuJoCo's default contact
THEORY: dict[str, Any] = {"color": BLACK, "lw": 1.0}
_RIGHT, _TOP = 0.15, 0.32  # margins around axes [in]
_LETTER = 0.073  # width of a letter, on average [in]
_LEGEND_ROW = 0.172  # height of a legend's row [in]
_HALF_A_DECADE, _FEW_DECADES = 3.0, 1e3  # largest over least, up to which decades are divided into 9 and 3
POINTS = 500  # of a line that can be told apart at the figures' width

Panels = tuple[Figure, ...]  # parts of a figure, drawn separately so that they stack on a narrow page
Lines = Sequence[tuple[Any, dict[str, Any]]]  # points and look
styled = matplotlib.rc_context(STYLE)


def subplots(
    height: float,
    rows: int = 1,
    columns: int = 1,
    *,
    width: float = 9.0,
    left: float = 0.8,
    bottom: float = 0.5,
    across: float = 0.8,
    down: float = 0.6,
    **more: Any,
) -> tuple[Figure, Any]:
    """A figure of this size [in], by default as wide as the page, and its axes in rows and columns.

    `left` and `bottom` are margins around the axes, `across` and `down` the gaps between them [in]; `more` is as for
    Figure.subplots.
    """
    figure = Figure(figsize=(width, height))
    axes = figure.subplots(rows, columns, **more)
    inner_width, inner_height = width - left - _RIGHT, height - bottom - _TOP
    figure.subplots_adjust(
        left=left / width,
        right=1 - _RIGHT / width,
        bottom=bottom / height,
        top=1 - _TOP / height,
        wspace=columns * across / (inner_width - (columns - 1) * across),  # shares of the size of one set of axes
        hspace=rows * down / (inner_height - (rows - 1) * down),
    )
    return figure, axes


def panel(title: str, xlabel: str, ylabel: str, **more: Any) -> tuple[Figure, Axes]:
    """A figure with one set of axes, about as wide as a phone; `more` is as for subplots."""
    figure, axes = subplots(3.6, width=4.6, **more)
    axes.set(title=title, xlabel=xlabel, ylabel=ylabel)
    return figure, axes


def margin_for(labels: Sequence[str]) -> float:
    """Width left of the axes that the labels of rows need [in]."""
    return 0.25 + _LETTER * max(map(len, labels), default=0)


def legend_below(
    figure: Figure, *legends: Sequence[Artist], ncols: int = 3, titles: Sequence[str] = (), **look: Any
) -> None:
    """Put one legend, or two side by side, below the axes; the figure grows, the axes don't."""
    rows = max(-(-len(handles) // ncols) for handles in legends) + bool(titles)
    height, extra = figure.get_figheight(), _LEGEND_ROW * rows + 0.1
    bottom, top = (edge * height + extra for edge in (figure.subplotpars.bottom, figure.subplotpars.top))
    figure.set_figheight(height + extra)
    figure.subplots_adjust(bottom=bottom / (height + extra), top=top / (height + extra))
    places = ("lower center",) if len(legends) == 1 else ("lower left", "lower right")
    for handles, place, title in itertools.zip_longest(legends, places, titles):
        figure.legend(handles=handles, **{"loc": place, "ncols": ncols, "title": title, "alignment": "left", **look})


def legend_beside_title(axes: Axes, handles: Sequence[Artist], **look: Any) -> None:
    """Put a legend in the line of the title, where the data can't be in its way."""
    place: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1, 0.98), "borderaxespad": 0}
    axes.legend(handles=handles, ncols=4, columnspacing=1.0, handletextpad=0.5, **place, **look)


def thin(rows: int, most: int = POINTS) -> slice:
    """Every n-th of `rows` rows, so that about `most` remain."""
    return slice(None, None, max(1, rows // most))


def limits_around(values: Array) -> tuple[float, float]:
    """Limits of an axis that shows values (n,) and zero."""
    low, high = min(0.0, float(values.min())), max(0.0, float(values.max()))
    room = 0.12 * (high - low) + 1e-4
    return low - room, high + room


def make_room(axes: Axes, share: float = 0.15) -> None:
    """Raise the top of the axes by a share of their height to make room for a legend."""
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + share * (high - low))


def shade(map_and_top: tuple[str, float], share: float) -> tuple[float, float, float, float]:
    """The colour at a share, 0 to 1, of the used part of a colour map."""
    name, top = map_and_top
    return matplotlib.colormaps[name](top * share)


def mark_span(axis: Axes, begin: float, end: float) -> None:
    """Shade a span of the horizontal axis, with a visible edge."""
    axis.axvspan(begin, end, facecolor=SHADE, edgecolor=GREY, lw=0.8, ls=":", zorder=0)


def law_line(name: str, **more: Any) -> dict[str, Any]:
    """Keywords of the line of the slip law or compensation `name`."""
    law = shown(name)
    return {"color": law.colour, "linestyle": law.dashes, **more}


def key(label: str, **look: Any) -> Line2D:
    """An entry of a legend."""
    return Line2D([], [], label=label, **look)


def zero_line(axes: Axes) -> None:
    """Mark the value zero."""
    axes.axhline(0, color="#888888", lw=0.8, zorder=1)


def log_ticks(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers: nine or three in a decade, or one where there are many decades."""
    low, high = axis.get_view_interval()
    steps: Sequence[float] = (1.0, 2.0, 5.0) if high < _FEW_DECADES * low else (1.0,)
    if high < _HALF_A_DECADE * low:
        steps = range(1, 10)
    axis.set_major_locator(LogLocator(subs=steps))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def errors_ahead(panels: Sequence[tuple[str, str, Lines]], ahead: Sequence[float], xlabel: str) -> Figure:
    """Errors against how far ahead they are; a panel for each title and label, with lines of points (n, 2)."""
    figure, axes = subplots(3.5, 1, len(panels), squeeze=False)
    for axis, (title, ylabel, lines) in zip(axes[0], panels, strict=True):
        for points, look in lines:
            if len(points):
                axis.plot(*np.transpose(points), marker="o", ms=3.5, **look)
        axis.set(title=title, xlabel=xlabel, ylabel=ylabel, xscale="log", yscale="log")
        axis.set_xticks(ahead, [f"{at:g}" for at in ahead])
        axis.set_xticks([], minor=True)
        log_ticks(axis.yaxis)
    return figure


def plane(axes: Axes, **more: Any) -> None:
    """Make axes a map of the ground; `more` is as for Axes.set."""
    axes.set(aspect="equal", **{"xlabel": "x [m]", "ylabel": "y [m]", **more})
