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
from experiments.report.laws import law_looks, shown, symbol
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
        assert all(symbol(parameter) != parameter for parameter in family.names)


def test_slip_against_speed_and_radius(found):
    turns = turns_of(found)
    figure = assert_readable(steady_runs.slip_against_speed_and_radius(turns, found.comparison.laws["icr_radius"]))
    assert bars(figure) == (4 if turns.errors is not None else 0)
    assert {"0.60 m", "best law", "Eq. 11"} <= set(legend_texts(figure))
    radius = RadiusSummary((0.5, 1.0), np.array([0.63, np.nan]), np.array([0.62, 1.34]), 0.01)
    driven_radii, _ = assert_readable(steady_runs.published_and_simulated(radius, turns)).axes
    np.testing.assert_array_equal(driven_radii.lines[-1].get_ydata(), radius.observed)


def test_all_laws_are_drawn_through_the_samples(found):
    turns = turns_of(found)
    figure = assert_readable(figures.fitted_laws(turns, found.comparison))
    assert bars(figure) == (2 if turns.errors is not None else 0)
    laws = figures.shown_laws(found.comparison)
    assert list(laws) == [*found.comparison.ranking, "published"]
    for axes in figure.axes:
        assert {shown(name).colour for name in laws} <= {line.get_color() for line in axes.lines}
    panels = [axes for axes in assert_readable(figures.residuals(turns, found.comparison)).axes if axes.axison]
    assert len(panels) == len(laws)
    assert len({axes.get_ylim() for axes in panels}) == 1


def test_criteria_and_correlations(found):
    figure = assert_readable(figures.criteria(found.comparison))
    names = figure.axes[0].get_yticklabels()
    assert [text.get_text() for text in names] == [shown(name).label for name in found.comparison.ranking]
    laws = figures.correlated_laws(found.comparison)
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
