"""Results in notebooks, data frames and figures."""

import dataclasses
import re
import subprocess
import sys
from functools import cache
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest
from drives import GEOMETRY, ICR, drive_log
from matplotlib.figure import Figure
from slip_data import circles, driven

import trackslip
from trackslip.errors import LogError, TrackslipError
from trackslip.identification.identify import identify_samples
from trackslip.identification.samples import Sampling
from trackslip.kinematics import RobotGeometry
from trackslip.odometry.evaluation import odometry_errors
from trackslip.odometry.identified import identified_law
from trackslip.viewable import Viewable
from trackslip.views.figures import NotebookFigure

LAWS = ("none", "icr_radius")


@pytest.fixture(autouse=True)
def few_laws(monkeypatch):
    monkeypatch.setattr("trackslip.identification.drive_comparison.drive_laws", lambda: LAWS)


@cache
def of_drives():
    return trackslip.identify([drive_log(1, 60.0)], GEOMETRY, method="drive")


@cache
def of_samples():
    samples = driven([*circles(), *circles(side=-1), (0.2, 0.0)])
    return identify_samples(Sampling.of([samples], []), GEOMETRY)


@cache
def errors_of_odometry():
    return odometry_errors(drive_log(2, 60.0), identified_law(of_drives()).odometry())


def errors_of_tracking():
    reference = trackslip.circle(1.0, 0.2, 30.0)
    time = np.linspace(0.0, reference.duration, 200)
    pose = reference.pose(time) + np.array([0.003, 0.004, 0.0])
    return trackslip.tracking_errors(time, pose, reference)


def benchmark():
    entry = {
        "rank": 1,
        "controller": "linear",
        "compensation": "icr_radius",
        "start": "zero",
        "score": 0.0019,
        "score_ci95": [0.0017, 0.0021],
        "gain": 700.0,
        "success": 1.0,
    }
    single = entry | {"compensation": "none", "score": 0.5, "score_ci95": None, "gain": None}
    return trackslip.BenchmarkResults((entry, single), ({"run": "a"}, {"run": "b"}))


RESULTS = {
    "drives": of_drives,
    "samples": of_samples,
    "log": lambda: drive_log(1, 10.0),
    "odometry": errors_of_odometry,
    "tracking": errors_of_tracking,
    "benchmark": benchmark,
    "law": lambda: ICR,
    "paper's law": lambda: trackslip.PUBLISHED,
    "no slip": trackslip.NoSlip,
    "two laws": lambda: trackslip.ConstantIcr(np.array([0.05, 0.1]), half_gauge=0.168),
}


@pytest.fixture(params=RESULTS.values(), ids=RESULTS)
def result(request):
    return request.param()


class Cells(HTMLParser):
    """The texts of a table's cells, row by row."""

    def __init__(self, html):
        super().__init__()
        self.rows = []
        self.open = []
        self.feed(html)
        assert not self.open, "a tag is not closed"

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if {"td", "th"} & set(self.open):
            self.rows[-1][-1] += data


def cells(result):
    header, *rows = Cells(result._repr_html_()).rows
    assert all(len(row) == len(header) for row in rows)
    return rows


def test_html_is_a_small_well_formed_table(result):
    html = result._repr_html_()
    assert len(html) < 6000
    cells(result)
    assert "nan" not in html


def test_repr_is_short(result):
    assert len(repr(result)) < 600


def test_every_part_of_a_result_has_a_short_repr():
    seen = set()

    def walk(value, place):
        if not dataclasses.is_dataclass(value) or id(value) in seen:
            if isinstance(value, dict | tuple | list):
                for item in value.values() if isinstance(value, dict) else value:
                    walk(item, place)
            return
        seen.add(id(value))
        assert len(repr(value)) < 2500, place
        for field in dataclasses.fields(value):
            walk(getattr(value, field.name), f"{place}.{field.name}")

    for name in ("drives", "samples", "odometry", "log"):
        walk(RESULTS[name](), name)
    assert len(seen) > 30


def test_every_data_frame_library_reads_the_same_table(result):
    table = pa.table(result)
    assert pl.DataFrame(result).columns == table.column_names
    frame = result.to_pandas()
    assert isinstance(frame, pd.DataFrame)
    assert list(frame.columns) == table.column_names
    assert len(frame) == table.num_rows


def test_plot_returns_a_labelled_figure_that_notebooks_show(result):
    figure = result.plot()
    assert isinstance(figure, Figure)
    assert figure.axes
    for axes in figure.axes:
        assert axes.get_xlabel()
    assert figure._repr_png_().startswith(b"\x89PNG")


def lines_of(axes):
    """Points (n, 2) of the lines in the legend, by their labels."""
    return {
        line.get_label(): line.get_xydata()
        for line in axes.lines
        if not line.get_label().startswith("_")
    }


def test_the_curves_of_a_law_are_its_slips_up_to_the_pole():
    """Over the angle atan(b / R), whose tangent is b w / v, between turns on the spot."""
    law = trackslip.ConstantIcr(0.1, 0.2)
    (axes,) = law.plot().axes
    drawn = lines_of(axes)
    assert [*drawn] == ["left track", "right track"]
    assert axes.get_xlim() == (-90.0, 90.0)
    assert "b = 0.2 m" in axes.get_xlabel()
    for track, points in enumerate(drawn.values()):
        angle, slip = points.T
        assert (angle[0], angle[-1]) == (-89.0, 89.0)
        twists = np.column_stack([np.cos(np.radians(angle)), np.sin(np.radians(angle)) / 0.2])
        expected = law.slip(twists)[:, track]
        is_drawn = np.abs(expected) < 1
        assert 100 < is_drawn.sum() < 600
        np.testing.assert_allclose(slip[is_drawn], expected[is_drawn], atol=1e-12)
        assert np.isnan(slip[~is_drawn]).all()
    straight = drawn["left track"][300]
    np.testing.assert_allclose(straight, [0.0, 0.0], atol=1e-12)
    assert axes.get_title() == "ConstantIcr"


def test_laws_that_depend_on_speed_are_drawn_at_one_that_is_told():
    @dataclasses.dataclass(frozen=True)
    class Hasty(trackslip.SlipLaw):
        half_gauge: float = 0.2

        def __call__(self, kappa):
            return np.zeros((*np.shape(kappa), 2))

        def slip(self, twist):
            return np.repeat(np.abs(np.asarray(twist, float)[..., :1]), 2, axis=-1)

    (axes,) = Hasty().plot().axes
    assert axes.get_title() == "Hasty at 0.3 m/s"
    assert lines_of(axes)["left track"][300] == pytest.approx([0.0, 0.3])


def test_path_and_speeds_of_a_log_are_drawn_from_its_start():
    log = drive_log(1, 60.0)
    path, speeds = log.plot().axes
    measured, start = (line.get_xydata() for line in path.lines)
    placed = log.pose[log.has_place, :2]
    np.testing.assert_array_equal(start, placed[:1])
    stride = max(1, len(placed) // 2000)
    np.testing.assert_array_equal(measured, placed[::stride])
    assert path.get_legend_handles_labels()[1] == ["start"]
    drawn = lines_of(speeds)
    assert [*drawn] == ["left", "right"]
    stride = max(1, len(log.time) // 2000)
    for track, points in enumerate(drawn.values()):
        np.testing.assert_array_equal(
            points, np.stack([log.time, log.omega[:, track]], 1)[::stride]
        )
        assert len(points) < 4000


def test_measured_slips_lie_at_the_sharpness_of_their_turns():
    """Also of turns backwards, whose path bends to the same side."""
    samples = driven([*circles(), (-0.2, -0.3), (0.2, 0.0)])
    found = identify_samples(Sampling.of([samples], []), GEOMETRY)
    (axes,) = found.plot().axes
    left, right = (line.get_xydata() for line in axes.lines[:2])
    forwards, turn = samples.twist.T
    assert (forwards < 0).any()
    expected = np.degrees(np.arctan(GEOMETRY.half_gauge * turn / forwards))
    for track, dots in enumerate((left, right)):
        np.testing.assert_allclose(dots[:, 0], expected)
        np.testing.assert_array_equal(dots[:, 1], samples.slip[:, track])
    best = found.comparison.best
    assert axes.get_title() == f"Measured slip (dots) and law {best}"
    curve = lines_of(axes)["right track"]
    twist = np.array([np.cos(np.radians(curve[450, 0])), np.nan])
    twist[1] = np.sin(np.radians(curve[450, 0])) / GEOMETRY.half_gauge
    law = found.comparison.laws[best].law
    assert curve[450, 1] == pytest.approx(law.slip(0.3 * twist[None])[0, 1])


def test_errors_of_predictions_are_medians_over_the_time_ahead():
    found = of_drives()
    errors = found.drive.errors
    for axes, quantity, factor in zip(
        found.plot().axes, ("position", "heading"), (1.0, 180 / np.pi), strict=True
    ):
        drawn = lines_of(axes)
        labels = {f"{found.drive.best} (best)": found.drive.best, "today, without slip": "today"}
        assert set(drawn) <= set(labels)
        assert f"{found.drive.best} (best)" in drawn
        assert len(axes.lines) == len(errors)
        for label, points in drawn.items():
            by_horizon = errors[labels[label]]
            assert points[:, 0].tolist() == [*by_horizon]
            medians = [factor * getattr(each, quantity).median for each in by_horizon.values()]
            np.testing.assert_allclose(points[:, 1], medians)
        assert axes.get_ylim()[0] == 0
        assert axes.get_ylabel() == f"median error [{'m' if quantity == 'position' else '°'}]"


def test_errors_of_odometry_are_drawn_over_the_distance():
    errors = errors_of_odometry()
    for axes, quantity, factor in zip(
        errors.plot().axes, ("position", "heading"), (1.0, 180 / np.pi), strict=True
    ):
        drawn = lines_of(axes)
        known = {at: getattr(each, quantity) for at, each in errors.after_metres.items()}
        assert drawn["median"][:, 0].tolist() == [*known]
        medians = [factor * part.median for part in known.values()]
        most = [factor * part.p90 for part in known.values()]
        np.testing.assert_allclose(drawn["median"][:, 1], medians)
        np.testing.assert_allclose(drawn["90 % are below"][:, 1], most)
        assert axes.get_xlabel() == "distance driven [m]"
    nothing = dataclasses.replace(errors, after_metres={})
    axes, _ = nothing.plot().axes
    assert axes.get_xlabel() == "time [s]"


def test_errors_that_were_not_measured_say_so():
    nothing = dataclasses.replace(errors_of_odometry(), after_metres={}, after_seconds={})
    for axes in nothing.plot().axes:
        assert not axes.lines
        assert [text.get_text() for text in axes.texts] == ["not measured"]


def test_bars_of_tracking_errors_are_those_that_are_known():
    errors = dataclasses.replace(
        errors_of_tracking(),
        rms_position=1e-3,
        rms_position_after_12s=2e-3,
        rms_position_arc=np.nan,
        cross_track=3e-3,
        final_position=4e-3,
        max_position=5e-3,
    )
    (axes,) = errors.plot().axes
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert names == ["rms", "rms from 12 s on", "rms across the path", "at the end", "largest"]
    np.testing.assert_allclose([bar.get_width() for bar in axes.patches], [1, 2, 3, 4, 5])
    assert axes.yaxis_inverted()


def test_bars_of_tracking_errors_are_in_millimetres():
    """The robot is 3 mm ahead and 4 mm to the left of its reference all the time."""
    (axes,) = errors_of_tracking().plot().axes
    bars = dict(zip(axes.get_yticklabels(), axes.patches, strict=True))
    widths = {label.get_text(): bar.get_width() for label, bar in bars.items()}
    assert widths["rms"] == pytest.approx(5.0)
    assert widths["largest"] == pytest.approx(5.0)
    assert axes.get_xlabel() == "error [mm]"


def test_scores_of_a_benchmark_are_in_millimetres():
    (axes,) = benchmark().plot().axes
    interval, first, second = (line.get_xdata() for line in axes.lines)
    np.testing.assert_allclose(interval, [1.7, 2.1])
    np.testing.assert_allclose([*first, *second], [1.9, 500.0])
    assert "[mm]" in axes.get_xlabel()


def test_rows_of_a_benchmark_name_starts_that_differ():
    results = benchmark()
    (axes,) = results.plot().axes
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert names == ["linear, icr_radius", "linear, none"]
    assert axes.get_ylim() == (1.5, -0.5)  # the best on top
    first, second = results.entries
    apart = dataclasses.replace(results, entries=(first, second | {"start": "paper"}))
    (axes,) = apart.plot().axes
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert names == ["linear, icr_radius, zero", "linear, none, paper"]


def test_plot_draws_into_a_figure_that_is_given():
    figure = Figure()
    assert ICR.plot(figure) is figure
    assert not isinstance(figure, NotebookFigure)
    assert len(figure.axes) == 1


def test_the_table_of_a_law_has_symbols_and_units():
    assert [row[:2] for row in cells(ICR)] == [["D", "45 mm"], ["b", "168 mm"], ["ε", "0.66 %"]]


def test_the_table_of_an_identification_has_units_and_intervals():
    rows = {row[0]: row[1:] for row in cells(of_drives())}
    value, law = rows["D"]
    assert re.fullmatch(r"4\d\.\d+ mm \(\d\d\.\d+ to \d\d\.\d+\)", value)
    assert law == of_drives().expressible
    low, high = of_drives().intervals["icr_radius"]["offset"]
    assert low < ICR.offset < high
    assert {"wheel_separation_multiplier", "left_wheel_radius_multiplier"} <= rows.keys()


def test_alarms_stand_above_the_table():
    few = trackslip.identify([drive_log(1, 10.0)], GEOMETRY, method="drive")
    assert few.alarms
    html = few._repr_html_()
    assert html.index("ALARM") < html.index("<table>")


def test_values_without_an_interval_say_so():
    few = trackslip.identify([drive_log(1, 10.0)], GEOMETRY, method="drive")
    assert "too little driving for an interval" in few._repr_html_()
    frame = pl.DataFrame(few)
    of_law = frame.filter(pl.col("parameter") == "offset")
    assert of_law["low"].null_count() == len(of_law)


def test_the_table_of_parameters_has_the_answer_first():
    found = of_drives()
    frame = found.to_pandas()
    answer = frame.set_index("parameter").loc["wheel_separation_multiplier"]
    assert answer["value"] == found.answer["wheel_separation_multiplier"].value
    rows = frame[frame.law.eq("icr_radius") & frame.parameter.eq("offset")]
    assert rows["value"].item() == found.laws["icr_radius"].offset
    assert rows["unit"].item() == "m"
    assert rows["best"].item() == (found.best == "icr_radius")


def test_a_log_goes_through_a_data_frame_and_back():
    log = drive_log(1, 60.0)
    direct = trackslip.identify(log, GEOMETRY, method="drive")
    frames = (log.to_pandas(), pl.DataFrame(log), pa.table(log))
    for frame in frames:
        again = trackslip.identify(frame, GEOMETRY, method="drive")
        assert again.answer["offset"].value == pytest.approx(direct.answer["offset"].value)


def test_a_log_without_positions_shows_its_headings():
    log = drive_log(1, 10.0)
    pose = log.pose.copy()
    pose[:, :2] = np.nan
    headings = dataclasses.replace(log, pose=pose)
    assert "no positions" in headings._repr_html_()
    titles = [axes.get_title() for axes in headings.plot().axes]
    assert titles == ["Measured heading", "Sprocket speeds"]


def test_a_law_of_ones_own_is_shown_by_its_numbers():
    @dataclasses.dataclass(frozen=True)
    class Own(trackslip.SlipLaw):
        gain: float = 0.5
        name: str = "mine"

        def __call__(self, kappa):
            slip = self.gain * np.asarray(kappa, float)
            return np.stack([slip, -slip], axis=-1)

    assert [row[:2] for row in cells(Own())] == [["gain", "0.5"]]
    assert Own().plot().axes[0].lines
    assert Own().to_pandas()["value"].tolist() == [0.5]


def test_text_of_users_is_escaped():
    log = dataclasses.replace(drive_log(1, 5.0), run="<script>")
    assert "<script>" not in log._repr_html_()


def test_plots_are_imported_only_to_plot():
    code = (
        "import sys, numpy as np, trackslip\n"
        "law = trackslip.ConstantIcr(0.1, half_gauge=0.3)\n"
        "law._repr_html_(), repr(law), law.__arrow_c_stream__()\n"
        "assert 'matplotlib' not in sys.modules\n"
        "law.plot()\n"
        "assert 'matplotlib' in sys.modules and 'matplotlib.pyplot' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_without_pandas_another_way_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(TrackslipError, match=r"pip install pandas.*polars.DataFrame"):
        ICR.to_pandas()


def test_all_public_results_are_viewable():
    shown = {name for name in trackslip.__all__ if name.endswith(("Errors", "Results"))}
    shown -= {"LawErrors"}
    for name in {*shown, "Identification", "RunLog", "SlipLaw", "LogComparison"}:
        assert issubclass(getattr(trackslip, name), Viewable), name


def test_a_folder_without_a_benchmark_is_refused(tmp_path):
    (tmp_path / "summary.json").write_text('{"laws": {}}')
    with pytest.raises(LogError, match="isn't the summary of `trackslip benchmark`"):
        trackslip.load_benchmark(tmp_path)
    with pytest.raises(LogError, match="No such file"):
        trackslip.load_benchmark(tmp_path / "none")


def test_a_geometry_stays_plain():
    assert repr(RobotGeometry(0.3, 0.1)) == "RobotGeometry(half_gauge=0.3, sprocket_radius=0.1)"
