"""Charts: curves over two axes, described once and drawn both for print and to zoom on a page."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from experiments.common.colours import BLACK, GREY
from experiments.common.laws import shown
from experiments.common.style import legend_below, mark_span, plane, styled, subplots, zero_line
from trackslip.kinematics import Array

PANEL: Final = 4.6
"""Width of a chart that stands beside another, about that of a phone [in]."""
WIDE: Final = 9.0
"""Width of a chart as wide as the page [in]."""
_EDGE: Final = 0.8  # width of an edge on each side of a line [pt]


@dataclass(frozen=True)
class Curve:
    """A line with or without marks, or marks alone."""

    x: Array  # (n,)
    y: Array  # (n,), NaN for a gap
    label: str = ""
    """Entry in the legend; curves with the same label share one, and are hidden together."""
    colour: str = BLACK
    width: float = 1.5
    """Width of the line [pt]; 0 for marks alone."""
    dashes: Any = "-"
    """Style of the line, as matplotlib's: a name, or an offset and lengths [line widths]."""
    marker: str = ""
    """Kind of the marks, as matplotlib's: o, s or x; none if empty."""
    size: float = 4.0
    """Diameter of the marks [pt]."""
    edge: str = ""
    """Colour of the line's edges; none if empty."""
    floor: float | None = None
    """Height to which the area below the line is filled, instead of drawing the line."""


def law_curve(x: Array, y: Array, name: str, label: str = "", width: float = 1.5) -> Curve:
    """A curve in the colour and line style of the slip law or compensation `name`."""
    look = shown(name)
    return Curve(x, y, label or name, look.colour, width, look.dashes)


def road(pose: Array, label: str = "reference") -> Curve:
    """A path (n, 2 or 3) to be followed, as a road on a map."""
    return Curve(pose[:, 0], pose[:, 1], label, "#e3e3e3", 3.6, edge=GREY)


def dots(place: Array, label: str, colour: str = GREY, size: float = 2.0) -> Curve:
    """Points (n, 2 or 3) on a map."""
    return Curve(place[:, 0], place[:, 1], label, colour, 0.0, marker="o", size=size)


def start_of(place: Array) -> Curve:
    """The start of a path (n, 2 or 3) on a map."""
    return dots(place[:1], "start", BLACK, 6.0)


@dataclass(frozen=True)
class Chart:
    """Curves over two axes."""

    title: str
    xlabel: str
    ylabel: str
    curves: Sequence[Curve]
    """The curves, later ones on top of earlier ones."""
    height: float = 3.6
    """Height [in]; of a column of charts, that of each."""
    width: float = PANEL
    """Width [in]."""
    is_map: bool = False
    """Whether both axes have the same scale."""
    is_log: bool = False
    """Whether the vertical axis is logarithmic."""
    xlim: tuple[float, float] | None = None
    ylim: tuple[float, float] | None = None
    span: tuple[float, float] | None = None
    """A part of the horizontal axis that is shaded."""
    has_zero: bool = False
    """Whether a line marks zero on the vertical axis."""
    below: Sequence["Chart"] = ()
    """Charts below this one with the same horizontal axis, whose label the last one has."""

    @property
    def column(self) -> list["Chart"]:
        """This chart and those below it."""
        return [self, *self.below]

    @styled
    def figure(self) -> Figure:
        """The chart and those below it as a figure for print, with one legend."""
        column = self.column
        height = sum(chart.height for chart in column)
        figure, axes = subplots(
            height,
            len(column),
            width=self.width,
            squeeze=False,
            sharex=len(column) > 1,
            height_ratios=[chart.height for chart in column],
        )
        handles: dict[str, Any] = {}
        for chart, axis in zip(column, axes[:, 0], strict=True):
            handles |= dict(_drawn(chart, axis))
        for axis in axes[:-1, 0]:
            axis.set_xlabel("")
        if handles:
            columns = 3 if self.width <= PANEL else 6
            legend_below(figure, list(handles.values()), columns, handlelength=3.0)
        return figure


def _drawn(chart: Chart, axis: Axes) -> Iterator[tuple[str, Any]]:
    """Draw a chart; yields the handle of each label."""
    if chart.span is not None:
        mark_span(axis, *chart.span)
    if chart.has_zero:
        zero_line(axis)
    for curve in chart.curves:
        handle = _drawn_curve(curve, axis)
        if curve.label:
            yield curve.label, handle
    if chart.is_map:
        plane(axis, adjustable="datalim")
    if chart.is_log:
        axis.set_yscale("log")
    axis.set(title=chart.title, xlabel=chart.xlabel, ylabel=chart.ylabel)
    if chart.xlim is not None:
        axis.set_xlim(*chart.xlim)
    if chart.ylim is not None:
        axis.set_ylim(*chart.ylim)


def _drawn_curve(curve: Curve, axis: Axes) -> Any:
    """Draw a curve; returns its handle for a legend."""
    if curve.floor is not None:
        return axis.fill_between(
            curve.x, curve.y, curve.floor, facecolor=curve.colour, lw=0, label=curve.label
        )
    (line,) = axis.plot(
        curve.x,
        curve.y,
        color=curve.colour,
        lw=curve.width,
        ls=curve.dashes if curve.width else "none",
        marker=curve.marker,
        ms=curve.size,
        label=curve.label,
    )
    if curve.edge:
        line.set(
            path_effects=[withStroke(linewidth=curve.width + 2 * _EDGE, foreground=curve.edge)]
        )
        line.set_solid_capstyle("round")
    return line
