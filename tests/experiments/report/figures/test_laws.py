"""Figures of identifications and of localization: every law in them, error bars where errors are known."""

import numpy as np
import pytest
from figures import assert_readable, legend_texts
from identified import GEOMETRY, driven, grid, identified
from matplotlib.container import ErrorbarContainer
from spin import spun_before_the_scanner

from experiments.measuring.grid import RadiusSummary
from experiments.measuring.sightings import sightings
from experiments.measuring.steady_turns import InnerOuterSamples
from experiments.report.figures import laws as figures
from experiments.report.figures import steady_runs
from experiments.report.figures.localization import error_against_viewing_angle
from experiments.report.figures.slip_under_load import slip_under_load
from experiments.report.laws import law_looks, shown, symbol, unit_of
from trackslip.identification.fitted import fit_law
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import SIDES
from trackslip.slip.families import FAMILIES
from trackslip.slip.icr_load import IcrLoad


@pytest.fixture(scope="module", params=[True, False], ids=["errors known", "errors unknown"])
def found(request):
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
        for parameter in family.names:
            assert symbol(parameter) != parameter
            assert unit_of(name, parameter)[1] in ("", "mm", "%", "1/m", "s/m")


def test_slip_against_speed_and_radius(found):
    turns = turns_of(found)
    figure = assert_readable(steady_runs.slip_against_speed_and_radius(turns, found.comparison.laws["icr_radius"]))
    assert bars(figure) == (4 if turns.errors is not None else 0)
    assert {"0.60 m", "best law", "Eq. 11"} <= set(legend_texts(figure))


def test_published_and_simulated(found):
    radius = RadiusSummary((0.5, 1.0), np.array([0.63, np.nan]), np.array([0.62, 1.34]), 0.01)
    driven_radii, _ = assert_readable(steady_runs.published_and_simulated(radius, turns_of(found))).axes
    np.testing.assert_array_equal(driven_radii.lines[-1].get_ydata(), radius.observed)


def test_all_laws_are_drawn_through_the_samples(found):
    turns = turns_of(found)
    figure = assert_readable(figures.fitted_laws(turns, found.comparison))
    assert bars(figure) == (2 if turns.errors is not None else 0)
    laws = figures.shown_laws(found.comparison)
    assert list(laws) == [*found.comparison.ranking, "published"]
    for axes in figure.axes:
        assert {shown(name).colour for name in laws} <= {line.get_color() for line in axes.lines}
    assert f"{shown('icr_radius').label} – best" in legend_texts(figure)


@pytest.mark.parametrize("count", [3, 5], ids=["free cells", "no free cell"])
def test_residuals_have_a_panel_for_each_law(found, count):
    some = identified(found.samples, ("icr_radius", "icr", "constant", "none", "exponential")[:count])
    figure = assert_readable(figures.residuals(turns_of(some), some.comparison))
    panels = [axes for axes in figure.axes if axes.axison]
    assert [axes.get_title(loc="left").removesuffix(" – best") for axes in panels] == [
        shown(name).label for name in figures.shown_laws(some.comparison)
    ]
    assert len({axes.get_ylim() for axes in panels}) == 1
    meaning = "scatter" if turns_of(found).errors is None else "standard errors"
    assert meaning in legend_texts(figure)[-1]


def test_criteria_stand_side_by_side(found):
    figure = assert_readable(figures.criteria(found.comparison))
    assert len(figure.axes) == 4
    names = figure.axes[0].get_yticklabels()
    assert [text.get_text() for text in names] == [shown(name).label for name in found.comparison.ranking]
    bold = [text.get_text() for text in names if text.get_fontweight() == "bold"]
    assert bold == [shown("icr_radius").label]


def test_correlations_of_the_best_law_and_the_paper_s(found):
    laws = figures.correlated_laws(found.comparison)
    assert [law.name for law in laws] == ["icr_radius", "exponential"]
    figure = assert_readable(figures.correlations(laws))
    written = [[text.get_text() for text in axes.texts] for axes in figure.axes]
    assert [len(texts) for texts in written] == [4, 16]
    assert written[0][:2] == ["1", f"{laws[0].correlation[0, 1]:+.2f}".replace("-", "−")]
    one = identified(driven(grid()), ("icr",), best="icr")
    assert figures.correlated_laws(one.comparison) == []


LAW = IcrLoad(0.04, GEOMETRY.half_gauge, 0.01, 0.1, 0.2)


@pytest.fixture(scope="module")
def samples():
    curvature = np.repeat([0.5, 1.0, 2.0], 6)
    omega = 3.0 * (1 + SIDES * GEOMETRY.half_gauge * curvature[:, None])
    load = np.column_stack([np.tile(np.linspace(-0.2, 0.2, 6), 3), np.zeros(18)])
    names = [f"run {k}" for k in range(18)]
    return SlipSamples.of(omega, LAW.under(load).twist(omega, GEOMETRY), GEOMETRY, names, load=load)


def test_points_lie_on_the_lines_of_the_law_that_made_them(samples):
    figure = slip_under_load(samples, fit_law("icr_load", samples, GEOMETRY, bootstraps=0), GEOMETRY)
    (axes,) = figure.axes
    points = axes.collections[0].get_offsets()
    straightest, _, tightest = axes.lines
    for rows, line in ((slice(6), straightest), (slice(12, 18), tightest)):
        np.testing.assert_allclose(np.interp(points[rows, 0], *line.get_data()), points[rows, 1], atol=1e-3)
    assert axes.get_xlabel().endswith("]")


def test_residuals_of_the_law_take_the_load_into_account(samples):
    np.testing.assert_allclose(InnerOuterSamples.of(samples, GEOMETRY).residual(LAW), 0.0, atol=1e-12)


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_errors_are_those_of_the_poses_and_stand_beside_the_bound(factor):
    seen = sightings([spun_before_the_scanner(factor=factor)])
    assert seen is not None
    assert 0 <= seen.angle.min() < seen.angle.max() <= np.pi / 2
    clear = seen.measured & (seen.angle > np.radians(5))
    ratio = np.sqrt(np.mean((seen.error / seen.bound)[clear] ** 2, axis=0))
    np.testing.assert_allclose(ratio, factor, rtol=0.08)
    assert (seen.angle.size, np.sum(~seen.measured)) == (2000, 200)
    np.testing.assert_allclose(seen.ratio(), factor, rtol=0.1)
    figure = assert_readable(error_against_viewing_angle(seen))
    assert [axis.get_ylabel() for axis in figure.axes] == ["error of position, rms [mm]", "error of heading, rms [°]"]
    assert [len(axis.lines) for axis in figure.axes] == [4, 2]
