"""Charts that zoom on a page, drawn by Bokeh, whose script the page contains."""

import functools
import json
from collections.abc import Sequence
from typing import Any, Final

from markupsafe import Markup

from experiments.common.chart import Chart, Curve
from experiments.common.colours import GREY, SHADE

_POINT: Final = 100 / 72  # a point on the page, on which a figure's inch is about 100 px [px]
_TOOLS: Final = "pan,wheel_zoom,box_zoom,reset"
_DASHES: Final = {"-": "solid", "--": "dashed", "-.": "dashdot", ":": "dotted"}
_MARKERS: Final = {"o": "circle", "s": "square", "x": "x"}
_TEXT: Final = "12px"
_GRID: Final = "#e4e4e4"
# a legend in as many lines as it needs
_WRAPPED: Final = """
:host { max-width: 100%; grid-template-columns: minmax(0, 1fr); }
.bk-grid { display: flex; flex-wrap: wrap; width: auto; column-gap: 16px; }
.bk-label { white-space: normal; overflow-wrap: anywhere; }
"""

LOADER: Final = Markup("""
const isTouched = matchMedia("(pointer: coarse)").matches;
for (const card of document.querySelectorAll(".card")) {
  for (const data of card.querySelectorAll("script")) {
    const item = JSON.parse(data.textContent);
    card.classList.add("live");
    Bokeh.embed.embed_item(item, data.previousElementSibling).then(views => {
      for (const view of views) {
        for (const model of view.model.references()) {
          if (isTouched && model.type === "PanTool") model.active = false;
        }
      }
    });
  }
}
""")
"""Script of a page that draws its charts in place of the figures for print. Where fingers scroll
the page, they move a chart only once its tool is chosen.
"""


@functools.cache
def library() -> Markup:
    """Bokeh's script, as text that can stand in a <script> element."""
    from bokeh.resources import Resources  # imported late, because it takes a second

    script, *_ = Resources(mode="inline", components=["bokeh"]).js_raw
    return Markup(script)


def zoomable(chart: Chart) -> Markup:
    """A chart and those below it, as JSON for BokehJS that can stand in a <script> element."""
    from bokeh.embed import json_item
    from bokeh.layouts import gridplot

    plots: list[Any] = []
    for part in chart.column:
        plots.append(_plot(part, plots[0].x_range if plots else None))
    _hide_together(plots)
    _add_legends(plots)
    for plot in plots[:-1]:
        plot.xaxis.axis_label = None
    shown = plots[0]
    if len(plots) > 1:
        rows = [[plot] for plot in plots]
        shown = gridplot(rows, sizing_mode="stretch_width", toolbar_location="above")
    text = json.dumps(json_item(shown))
    return Markup(text.replace("<", "\\u003c"))


def _plot(chart: Chart, x_range: Any) -> Any:
    """A chart as Bokeh's figure, on a horizontal axis that it shares if `x_range` is given."""
    from bokeh.models import HoverTool
    from bokeh.models.annotations import BoxAnnotation, Span
    from bokeh.plotting import figure

    ranges: dict[str, Any] = {}
    if x_range is not None:
        ranges["x_range"] = x_range
    elif chart.xlim is not None:
        ranges["x_range"] = chart.xlim
    if chart.ylim is not None:
        ranges["y_range"] = chart.ylim
    plot = figure(
        title=chart.title or None,
        x_axis_label=chart.xlabel,
        y_axis_label=chart.ylabel,
        y_axis_type="log" if chart.is_log else "auto",
        height=round(100 * chart.height),
        sizing_mode="stretch_width",
        match_aspect=chart.is_map,
        tools=_TOOLS,
        toolbar_location="above",
        **ranges,
    )
    plot.toolbar.logo = None
    plot.outline_line_color = None
    plot.grid.grid_line_color = _GRID
    plot.axis.minor_tick_line_color = None
    plot.axis.axis_label_text_font_style = "normal"
    plot.axis.axis_label_text_font_size = _TEXT
    plot.axis.major_label_text_font_size = _TEXT
    if chart.span is not None:
        begin, end = chart.span
        shade = BoxAnnotation(
            left=begin, right=end, fill_color=SHADE, line_color=GREY, level="underlay"
        )
        plot.add_layout(shade)
    if chart.has_zero:
        plot.add_layout(Span(location=0.0, line_color=GREY, level="underlay"))
    for curve in chart.curves:
        _add(plot, curve)
    tips = [("", "$name"), (chart.xlabel or "x", "$x"), (chart.ylabel, "$y")]
    plot.add_tools(HoverTool(tooltips=tips))
    return plot


def _add(plot: Any, curve: Curve) -> None:
    """Add a curve to a figure; its parts have the curve's label as their name."""
    named = {"name": curve.label}
    if curve.floor is not None:
        plot.varea(curve.x, curve.floor, curve.y, fill_color=curve.colour, **named)
        return
    width = _POINT * curve.width
    if curve.edge:
        plot.line(curve.x, curve.y, color=curve.edge, width=width + 2, line_cap="round", **named)
    if curve.width:
        dash = _dash(curve.dashes, width)
        plot.line(curve.x, curve.y, color=curve.colour, width=width, line_dash=dash, **named)
    if curve.marker:
        plot.scatter(
            curve.x,
            curve.y,
            marker=_MARKERS[curve.marker],
            fill_color=curve.colour,
            line_color=curve.colour if curve.marker == "x" else None,
            size=_POINT * curve.size,
            **named,
        )


def _dash(dashes: Any, width: float) -> str | list[int]:
    """A line style of matplotlib's as one of Bokeh's, for a line of this width [px]."""
    if isinstance(dashes, str):
        return _DASHES[dashes]
    _, lengths = dashes
    return [max(1, round(length * width)) for length in lengths]


def _hide_together(plots: Sequence[Any]) -> None:
    """Hide curves of the same label in all charts of a column at once."""
    first: dict[str, Any] = {}
    for plot in plots:
        for part in plot.renderers:
            leader = first.setdefault(part.name, part)
            if leader is not part:
                leader.js_link("visible", part, "visible")
                part.js_link("visible", leader, "visible")


def _add_legends(plots: Sequence[Any]) -> None:
    """Add each label to the legend of the last chart that has it."""
    from bokeh.models.annotations import Legend, LegendItem

    known: set[str] = {""}
    for plot in reversed(plots):
        entries: dict[str, list[Any]] = {}
        for part in plot.renderers:
            if part.name not in known:
                entries.setdefault(part.name, []).append(part)
        known |= entries.keys()
        if entries:
            items = [
                LegendItem(label={"value": name}, renderers=parts)
                for name, parts in entries.items()
            ]
            legend = Legend(
                items=items,
                orientation="horizontal",
                click_policy="hide",
                location="left",
                border_line_color=None,
                margin=0,
                stylesheets=[_WRAPPED],
                label_text_font_size=_TEXT,
            )
            plot.add_layout(legend, "below")
