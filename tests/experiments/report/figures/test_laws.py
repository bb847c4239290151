"""Figures of an identification from steady runs: every law in them, error bars where errors are known."""

import numpy as np
import pytest
from figures import assert_readable, legend_texts
from identified import GEOMETRY, driven, grid, identified
from matplotlib.container import ErrorbarContainer
from spin import spun_before_the_scanner

from experiments.measuring.grid import RadiusSummary
from experiments.measuring.steady_turns import InnerOuterSamples
from experiments.report.figures import laws as figures
from experiments.report.figures import steady_runs
from experiments.report.laws import law_looks, shown, symbol, unit_of
from trackslip.slip.families import FAMILIES


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


def test_pose_velocity_and_truth_of_a_run():
    log = spun_before_the_scanner(400)
    figure = assert_readable(steady_runs.pose_and_velocity(log))
    position = figure.axes[0]
    x, y, *true = position.lines
    assert [line.get_label() for line in (x, y)] == ["x", "y"]
    np.testing.assert_allclose(true[0].get_ydata(), log.truth.pose[:, 0])
    assert "truth" in legend_texts(figure)


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


def test_wide_radii_have_a_logarithmic_axis():
    found = identified(driven([(0.1, 0.1 / radius) for radius in np.geomspace(0.4, 14, 10)]), ("icr", "icr_radius"))
    figure = assert_readable(figures.fitted_laws(turns_of(found), found.comparison))
    assert all(axes.get_xscale() == "log" for axes in figure.axes)


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


def test_criteria_that_are_not_known_are_said_to_be():
    found = identified(driven(grid()[:4], errors=False), ("constant", "icr", "icr_radius"), determined=False)
    figure = figures.criteria(found.comparison)
    assert [text.get_text() for axes in figure.axes for text in axes.texts] == ["not known"] * 12


def test_correlations_of_the_best_law_and_the_paper_s(found):
    laws = figures.correlated_laws(found.comparison)
    assert [law.name for law in laws] == ["icr_radius", "exponential"]
    figure = assert_readable(figures.correlations(laws))
    written = [[text.get_text() for text in axes.texts] for axes in figure.axes]
    assert [len(texts) for texts in written] == [4, 16]
    assert written[0][:2] == ["1", f"{laws[0].correlation[0, 1]:+.2f}".replace("-", "−")]
    one = identified(driven(grid()), ("icr",), best="icr")
    assert figures.correlated_laws(one.comparison) == []
