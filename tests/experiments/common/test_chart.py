import json
from dataclasses import replace

import numpy as np
import pytest
from figures import assert_readable

from experiments.common.chart import WIDE, Chart, Curve, dots, law_curve, road, start_of
from experiments.common.page import Page, Plot, Section
from experiments.common.zoom import library, zoomable

TIME = np.linspace(0.0, 10.0, 50)
PATH = np.column_stack([TIME, np.sin(TIME)])
pytestmark = pytest.mark.usefixtures("with_figures")
HOSTILE = "</script><script>alert('1')</script> & \"name\""

MAP = Chart(
    "Path",
    "x [m]",
    "y [m]",
    [
        road(PATH),
        law_curve(*PATH.T, "icr_radius"),
        law_curve(*PATH.T, "none", "without a law"),
        dots(PATH, "measured"),
        start_of(PATH),
        Curve(TIME, TIME / 5, "ground", floor=-1.0),
    ],
    is_map=True,
)
ERRORS = Chart(
    "Errors",
    "time [s]",
    "error [mm]",
    [Curve(TIME, np.sin(TIME), "ahead"), Curve(TIME, np.cos(TIME), "to the left", "#0072B2")],
    has_zero=True,
    span=(2.0, 5.0),
    below=[Chart("", "time [s]", "heading [°]", [Curve(TIME, np.cos(TIME), "ahead")], width=WIDE)],
)


def models(chart, kind):
    """The attributes of all models of a kind in a chart that zooms."""
    found = []

    def search(value):
        if isinstance(value, dict):
            if value.get("name") == kind and value.get("type") == "object":
                found.append(value.get("attributes", {}))
            value = list(value.values())
        if isinstance(value, list):
            for part in value:
                search(part)

    search(json.loads(zoomable(chart)))
    return found


@pytest.mark.parametrize("chart", [MAP, ERRORS, replace(ERRORS, is_log=True)])
def test_a_chart_in_print_is_readable(chart):
    figure = assert_readable(chart.figure())
    assert [axes.get_ylabel() for axes in figure.axes] == [part.ylabel for part in chart.column]


def test_a_chart_in_print_has_the_data_and_looks_of_its_curves():
    (axes,) = MAP.figure().axes
    lines = {line.get_label(): line for line in axes.lines}
    curves = {curve.label: curve for curve in MAP.curves if curve.floor is None}
    assert set(lines) == set(curves)
    for label, curve in curves.items():
        line = lines[label]
        np.testing.assert_array_equal(line.get_xydata(), np.column_stack([curve.x, curve.y]))
        assert line.get_color() == curve.colour
        assert line.get_linewidth() == curve.width
        assert (line.get_linestyle() == "None") == (curve.width == 0)
        assert line.get_marker() == curve.marker
        assert line.get_markersize() == curve.size
        assert bool(line.get_path_effects()) == bool(curve.edge)

    # the ground is an area down to its floor
    (area,) = axes.collections
    corners = area.get_paths()[0].vertices
    assert corners[:, 1].min() == -1.0
    assert corners[:, 1].max() == TIME[-1] / 5


def test_axes_of_a_chart_in_print_are_as_described():
    chart = replace(ERRORS, is_log=True, xlim=(1.0, 9.0), ylim=(0.1, 2.0), below=())
    (axes,) = chart.figure().axes
    assert (axes.get_title(loc="left"), axes.get_xlabel()) == ("Errors", "time [s]")
    assert axes.get_yscale() == "log"
    assert (axes.get_xlim(), axes.get_ylim()) == ((1.0, 9.0), (0.1, 2.0))
    first, last = ERRORS.figure().axes
    assert (first.get_xlabel(), last.get_xlabel()) == ("", "time [s]")
    assert first.get_yscale() == "linear"
    (span,) = first.patches
    assert (span.get_x(), span.get_width()) == (2.0, 3.0)
    assert len(first.lines) == len(ERRORS.curves) + 1  # that of zero
    assert not last.patches


@pytest.mark.parametrize("chart", [MAP, ERRORS])
def test_both_drawings_have_the_same_legend(chart):
    (legend,) = chart.figure().legends
    printed = [text.get_text() for text in legend.get_texts()]
    live = [item["label"]["value"] for item in models(chart, "LegendItem")]
    labels = [curve.label for part in chart.column for curve in part.curves]
    assert printed == list(dict.fromkeys(labels))
    assert sorted(live) == sorted(printed)


def test_charts_of_a_column_zoom_together():
    figures = models(ERRORS, "Figure")
    first, second = (figure["x_range"] for figure in figures)
    assert second == {"id": first["id"]}


def test_a_curve_of_a_chart_has_all_its_points():
    chart = Chart("", "x [m]", "y [m]", [Curve(np.array([1.5, 2.5]), np.array([np.nan, 3.5]), "a")])
    (source,) = models(chart, "ColumnDataSource")
    columns = dict(source["data"]["entries"])
    shapes = [columns[name]["shape"] for name in ("x", "y")]
    assert shapes == [[2], [2]]


def test_pages_have_the_script_once_and_only_for_charts():
    plot = Plot("path", MAP, "Path")
    others = Plot("errors", [MAP, ERRORS], "Errors")
    with_charts = Page("A page", "", {}, [Section("Figures", [plot, others])]).html()
    assert with_charts.count("/* BEGIN bokeh.min.js */") == 1
    assert with_charts.count('<div class="zoom">') == 3
    assert len(with_charts) < 2e6
    without = Page("A page", "", {}, [Section("Figures", [Plot("a", MAP.figure(), "A")])]).html()
    assert "<script" not in without


def test_labels_of_charts_cannot_end_their_script():
    chart = Chart(HOSTILE, HOSTILE, HOSTILE, [Curve(TIME, TIME, HOSTILE)])
    text = zoomable(chart)
    assert "<" not in text
    (item,) = models(chart, "LegendItem")
    assert item["label"]["value"] == HOSTILE
    assert "</script" not in library()
