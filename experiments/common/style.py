"""The style of all figures, with the same colour and line style for a slip law everywhere."""

from collections.abc import Sequence
from typing import Any, Final

import matplotlib
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from experiments.common.colours import BLUE, GREY, ORANGE, SHADE
from experiments.common.laws import shown

# colours of the tracks
INNER: Final = ORANGE
OUTER: Final = BLUE
BAND: Final = "#d5e6d5"  # background of values too small to matter
STYLE: Final[dict[Any, Any]] = {
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
# colour maps, and the fraction dark enough to see
RADII_SHADES: Final = ("viridis", 0.6)
SPEED_SHADES: Final = ("plasma", 0.6)
MARKERS: Final = ("o", "s", "D", "^", "v", "P", "X", "<", ">", "p", "h", "*")

# parts of a figure, drawn separately so that they stack on a narrow page
Panels = tuple[Figure, ...]
Lines = Sequence[tuple[Any, dict[str, Any]]]  # points, and keywords for their line
styled = matplotlib.rc_context(STYLE)


def subplots(
    height: float, rows: int = 1, columns: int = 1, *, width: float = 9.0, **more: Any
) -> tuple[Figure, Any]:
    """A figure of this size [in], by default as wide as the page, and its axes; `more` goes to
    Figure.subplots.
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, **more)


def panel(
    title: str, xlabel: str, ylabel: str, height: float = 3.6, **more: Any
) -> tuple[Figure, Axes]:
    """A figure with one set of axes, about as wide as a phone; `more` goes to Figure.subplots."""
    figure, axes = subplots(height, width=4.6, **more)
    axes.set(title=title, xlabel=xlabel, ylabel=ylabel)
    return figure, axes


def legend_below(figure: Figure, handles: Sequence[Artist], ncols: int = 3, **look: Any) -> None:
    """Put a legend below all axes, which shrink to make room for it; `look` goes to
    Figure.legend.
    """
    figure.legend(handles=handles, loc="outside lower center", ncols=ncols, **look)


def thin(rows: int, most: int = 500) -> slice:
    """A slice with every n-th of `rows` rows, about `most` in all; the default is as many as a line
    can show.
    """
    return slice(None, None, max(1, rows // most))


def shade(map_and_top: tuple[str, float], share: float) -> tuple[float, float, float, float]:
    """The colour at `share`, 0 to 1, in the used part of a colour map."""
    name, top = map_and_top
    return matplotlib.colormaps[name](top * share)


def mark_span(axis: Axes, begin: float, end: float) -> None:
    """Shade a span of the horizontal axis, with a visible edge."""
    axis.axvspan(begin, end, facecolor=SHADE, edgecolor=GREY, lw=0.8, ls=":", zorder=0)


def law_line(name: str, **more: Any) -> dict[str, Any]:
    """Keywords for matplotlib to draw a line for the slip law or compensation `name`."""
    return {"color": shown(name).colour, "linestyle": shown(name).dashes, **more}


def key(label: str, **look: Any) -> Line2D:
    """A legend entry."""
    return Line2D([], [], label=label, **look)


def zero_line(axes: Axes) -> None:
    """Draw a horizontal line at zero."""
    axes.axhline(0, color="#888888", lw=0.8, zorder=1)


def log_ticks(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers: at 1, 2 and 5 in each decade, or at 1 to 9 if
    the range is short.
    """
    low, high = axis.get_view_interval()
    axis.set_major_locator(
        LogLocator(subs=range(1, 10) if high < 3 * low else (1.0, 2.0, 5.0), numticks=7)
    )
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def plane(axes: Axes, **more: Any) -> None:
    """Set up axes as a map of the ground; `more` goes to Axes.set."""
    axes.set(aspect="equal", **{"xlabel": "x [m]", "ylabel": "y [m]", **more})
