"""The page of an identification and its figures, for every kind of data."""

import html
import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from figures import assert_readable, legend_texts
from identifications import GEOMETRY, driven, grid, identified
from matplotlib.container import ErrorbarContainer
from spinning_robot import spun_before_the_scanner

from experiments.common.laws import law_looks, shown, symbol
from experiments.common.page import Plot
from experiments.identify import law_figures as figures
from experiments.identify import steady_figures as steady_runs
from experiments.identify.library import identification_page
from experiments.identify.load_figure import slip_under_load
from experiments.identify.localization_figures import error_against_viewing_angle
from experiments.identify.page import page, print_identification
from experiments.identify.sightings import sightings
from experiments.identify.steady_laws import criteria_table, law_table
from experiments.identify.steady_turns import InnerOuterSamples
from experiments.simulate.grid_summary import RadiusSummary
from trackslip.identification.fitted import fit_law
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import SIDES
from trackslip.slip.families import FAMILIES
from trackslip.slip.icr_load import IcrLoad

OF_LAWS = (
    "fig05_slip_over_speed_and_radius",
    "fig06_slip_laws",
    "residuals_of_laws",
    "comparison_of_laws",
    "correlations_of_parameters",
)
OF_DRIVES = ("drive_path", "drive_prediction_errors", "drive_residuals", "drive_clock_offset", "drive_correlations")


def plots(found):
    return tuple(block.name for block in page(found, "Laws", "", {}).blocks if isinstance(block, Plot))


def text_of(found):
    """The page's words, without figures and tags."""
    bare = re.sub(r"<svg.*?</svg>|<style>.*?</style>|<[^>]*>", " ", identification_page(found), flags=re.DOTALL)
    return html.unescape(" ".join(bare.split()))


@pytest.fixture(scope="module")
def found():
    return identified(driven(grid()), outliers=[("run 9", "it is 0.3 off")])


def test_laws_have_values_errors_and_intervals(found):
    groups, name = {}, ""
    for first, *cells in law_table(found).rows:
        name = first.name if first else name
        groups.setdefault(name, {})[cells[0]] = " ".join(cells[1:])
    assert groups.keys() == {*found.comparison.laws, "published"} - {"none"}
    fitted = found.comparison.laws["icr_radius"]
    for letter, parameter, factor in (("D", "offset", 1e3), ("ε", "radius_error", 1e2)):
        expected = [fitted.values[parameter], fitted.stderr[parameter], *fitted.interval95[parameter]]
        printed = re.findall(r"-?\d+\.\d+", groups["icr_radius"][letter].replace("−", "-"))
        assert [float(number) for number in printed] == pytest.approx(factor * np.array(expected), rel=0.06)


def test_laws_are_compared_by_rank(found):
    table = criteria_table(found)
    assert [row[0].name for row in table.rows] == [*found.comparison.ranking, "published"]
    best = found.comparison.laws[found.best]
    (row,) = [row for row in table.rows if row[0].mark]
    assert row[0].name == found.best
    assert float(row[table.header.index("rms")]) == pytest.approx(best.rms, abs=1e-5)
    misses = {row[0].name for row in table.rows[:-1] if row[-1].text == "misses"}
    assert misses == {name for name, law in found.comparison.laws.items() if law.lacks_fit}


@pytest.mark.parametrize(
    "twists",
    [
        grid(side=-1),
        [*grid(), *grid(side=-1), (0.1, 0.0), (0.2, 0.0)],
        [(0.0, 0.4), (0.0, -0.4), (0.0, 0.6), *grid()[:4]],
        [(0.1, 0.1 / radius) for radius in (0.5, 0.7, 1, 1.4, 2, 3, 4, 6, 9, 14)],
    ],
    ids=["right turns", "both sides and straight", "on the spot", "scattered radii"],
)
def test_all_kinds_of_turns_have_a_page(twists):
    found = identified(driven(twists), ("icr", "icr_radius"))
    assert re.findall(r'<figure id="(\w+)"', identification_page(found)) == list(OF_LAWS)


def test_few_straight_or_single_runs_have_a_page():
    straight = identified(driven([(0.1, 0.0), (0.2, 0.0), (0.15, 0.0)]), ("none",), best="none")
    assert plots(straight) == ("comparison_of_laws",)
    single = identified(driven([(0.1, 0.08)]), ("icr",), best="icr", determined=False)
    assert "at observed radii from 1.25 to 1.25 m" in text_of(single)
    samples = driven([(0.1, 0.1), (0.1, 0.2)], errors=False)
    few = text_of(identified(samples, ("constant", "icr", "icr_radius"), determined=False))
    assert "There are no error bars" in few
    assert "nan" not in few.lower().split()


@pytest.mark.parametrize("method", ["steady", "drive"])
def test_drives_follow_steady_runs(found, two_drives, method):
    both = replace(found, drive=two_drives.drive, method=method, logs=(spun_before_the_scanner(400),))
    assert plots(both) == ("fig04_pose_and_velocity", "localization_error", *OF_LAWS, *OF_DRIVES)
    words = text_of(both)
    assert "All of them run why run 9 it is 0.3 off" in words
    assert ("the laws above are the result" in words) == (method == "steady")


@pytest.fixture(scope="module", params=[True, False], ids=["errors known", "errors unknown"])
def either(request):
    return identified(driven(grid(), errors=request.param))


def turns_of(found):
    return InnerOuterSamples.of(found.samples, GEOMETRY)


def bars(figure):
    """Sets of error bars in all axes of a figure."""
    return sum(isinstance(part, ErrorbarContainer) for axes in figure.axes for part in axes.containers)


def test_every_family_is_shown_with_its_formula_and_symbols():
    for name, family in FAMILIES.items():
        assert name in law_looks()
        assert shown(name).formula != shown("a law of the user").formula
        assert all(symbol(name, parameter) != parameter for parameter in family.names)


def test_slip_against_speed_and_radius(either):
    turns = turns_of(either)
    figure = assert_readable(steady_runs.slip_against_speed_and_radius(turns, either.comparison.laws["icr_radius"]))
    assert bars(figure) == (4 if turns.errors is not None else 0)
    assert {"0.60 m", "best law", "Eq. 11"} <= set(legend_texts(figure))
    radius = RadiusSummary((0.5, 1.0), np.array([0.63, np.nan]), np.array([0.62, 1.34]), 0.01)
    driven_radii, _ = assert_readable(steady_runs.published_and_simulated(radius, turns)).axes
    np.testing.assert_array_equal(driven_radii.lines[-1].get_ydata(), radius.observed)


def test_all_laws_are_drawn_through_the_samples(either):
    turns = turns_of(either)
    figure = assert_readable(figures.fitted_laws(turns, either.comparison))
    assert bars(figure) == (2 if turns.errors is not None else 0)
    laws = figures.shown_laws(either.comparison)
    assert list(laws) == [*either.comparison.ranking, "published"]
    for axes in figure.axes:
        assert {shown(name).colour for name in laws} <= {line.get_color() for line in axes.lines}
    panels = [axes for axes in assert_readable(figures.residuals(turns, either.comparison)).axes if axes.axison]
    assert len(panels) == len(laws)
    assert len({axes.get_ylim() for axes in panels}) == 1


@pytest.mark.parametrize("names", [("exponential_speed",), ("exponential_speed", "turn_loss", "icr_sides", "icr_load")])
def test_no_panel_of_residuals_is_alone_in_its_row(found, names):
    laws = {name: found.comparison.laws["icr"] for name in (*found.comparison.laws, *names)}
    comparison = replace(found.comparison, laws=laws, aicc=dict.fromkeys(laws, 0.0))
    figure = assert_readable(figures.residuals(turns_of(found), comparison))
    rows = Counter(round(axes.get_position().y0, 6) for axes in figure.axes if axes.axison)
    assert len(names) + 6 == sum(rows.values())
    assert 1 not in rows.values()


def test_a_curve_is_wider_by_the_number_of_curves_that_hide_it():
    line = np.linspace(0.0, 1.0, 9)
    curves = {"a": line[None], "b": line[None] + 1e-4, "c": 1 - line[None], "d": np.stack([line, line])}
    assert figures.hidden_by(curves, 1e-3) == {"a": 1, "b": 0, "c": 0, "d": 0}


def test_criteria_and_correlations(either):
    figure = assert_readable(figures.criteria(either.comparison))
    names = figure.axes[0].get_yticklabels()
    assert [text.get_text() for text in names] == [shown(name).label for name in either.comparison.ranking]
    laws = figures.correlated_laws(either.comparison)
    assert [law.name for law in laws] == ["icr_radius", "exponential"]
    written = [[text.get_text() for text in axes.texts] for axes in assert_readable(figures.correlations(laws)).axes]
    assert [len(texts) for texts in written] == [4, 16]
    assert written[0][:2] == ["1", f"{laws[0].correlation[0, 1]:+.2f}".replace("-", "−")]


def test_under_load_points_lie_on_the_lines_of_the_law_that_made_them():
    law = IcrLoad(0.04, GEOMETRY.half_gauge, 0.01, 0.1, 0.2)
    omega = 3.0 * (1 + SIDES * GEOMETRY.half_gauge * np.repeat([0.5, 1.0, 2.0], 6)[:, None])
    load = np.column_stack([np.tile(np.linspace(-0.2, 0.2, 6), 3), np.zeros(18)])
    twist = law.under(load).twist(omega, GEOMETRY)
    samples = SlipSamples.of(omega, twist, GEOMETRY, [f"run {k}" for k in range(18)], load=load)
    np.testing.assert_allclose(InnerOuterSamples.of(samples, GEOMETRY).residual(law), 0.0, atol=1e-12)
    (axes,) = slip_under_load(samples, fit_law("icr_load", samples, GEOMETRY, bootstraps=0), GEOMETRY).axes
    points = axes.collections[0].get_offsets()
    straightest, _, tightest = axes.lines
    for rows, line in ((slice(6), straightest), (slice(12, 18), tightest)):
        np.testing.assert_allclose(np.interp(points[rows, 0], *line.get_data()), points[rows, 1], atol=1e-3)


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_errors_are_those_of_the_poses_and_stand_beside_the_bound(factor):
    seen = sightings([spun_before_the_scanner(factor=factor)])
    assert 0 <= seen.angle.min() < seen.angle.max() <= np.pi / 2
    clear = seen.measured & (seen.angle > np.radians(5))
    ratio = np.sqrt(np.mean((seen.error / seen.bound)[clear] ** 2, axis=0))
    np.testing.assert_allclose(ratio, factor, rtol=0.08)
    np.testing.assert_allclose(seen.ratio(), factor, rtol=0.1)
    assert [len(axis.lines) for axis in assert_readable(error_against_viewing_angle(seen)).axes] == [4, 2]


@pytest.mark.parametrize(
    "odd",
    [
        {"plate": None},
        {"plate": {"length": 10**400}},
        {"plate": {"size": 1.0}},
        {"scanner": 3},
        {"scanner": {"noise": "x"}},
        {"lrf": {}},
        {"lrf": {"mount": [1, 2]}},
        {"lrf": {"mount": [1, {}, 2]}},
    ],
)
def test_without_a_valid_plate_and_scanner_there_are_no_sightings(odd):
    log = spun_before_the_scanner(rows=20)
    assert sightings([replace(log, metadata=log.metadata | odd)]) is None


def test_tables_name_laws_by_label_and_by_option(found, capsys):
    page_text = text_of(found)
    for name in ("icr", "icr_radius"):
        assert f"{shown(name).label}{' best' * (name == 'icr_radius')} {name}" in page_text
    print_identification(found)
    assert capsys.readouterr().out.splitlines()[-1].startswith("best: icr_radius")


def test_the_terminal_says_why_a_law_with_a_larger_aicc_is_the_best(found, capsys):
    aicc = {name: 0.0 if name == "icr" else 1.0 for name in found.steady.aicc}
    print_identification(replace(found, steady=replace(found.steady, aicc=aicc)))
    reason, last = capsys.readouterr().out.splitlines()[-2:]
    assert reason == "icr has a smaller AICc than icr_radius, but does not predict left-out radii better"
    assert last.startswith("best: icr_radius")
