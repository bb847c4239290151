"""Figures of an identification: every law in them, units on the axes, error bars where errors are known."""

import pytest
from identified import GEOMETRY, driven, grid, identified

from experiments.measuring.inner_outer import InnerOuterSamples
from experiments.report.colours import COLOURS, DASHES, LABELS
from experiments.report.figures import laws as law_figures
from experiments.report.figures import steady_runs as figures
from experiments.report.figures.axes import BARS
from experiments.report.law_symbols import FORMULAS, SYMBOLS, unit_of
from trackslip.slip.families import FAMILIES


@pytest.fixture(scope="module")
def known():
    return identified(driven(grid()))


@pytest.fixture(scope="module")
def unknown():
    return identified(driven(grid(), errors=False))


def turns_of(found):
    return InnerOuterSamples.of(found.samples, GEOMETRY)


def bars(figure):
    """Lines of error bars in all axes of a figure."""
    return sum(line.get_color() == BARS["color"] for axis in figure.axes for line in axis.lines)


def labels(figure):
    legends = [*figure.legends, *(axis.get_legend() for axis in figure.axes if axis.get_legend())]
    return [text.get_text() for legend in legends for text in legend.get_texts()]


def assert_units(figure):
    """Every label of an axis ends in a unit in brackets."""
    named = [text for axis in figure.axes for text in (axis.get_xlabel(), axis.get_ylabel()) if text]
    assert named
    assert all(text.endswith("]") for text in named)


def test_every_family_has_a_look_a_name_and_a_formula():
    for name, family in FAMILIES.items():
        assert name in COLOURS
        assert name in LABELS
        assert name in FORMULAS
        for parameter in family.names:
            assert parameter in SYMBOLS
            assert unit_of(name, parameter)[1] in ("", "mm", "%", "1/m", "s/m")
    looks = {(COLOURS[name], str(DASHES[name])) for name in COLOURS}
    assert len(looks) == len(COLOURS) == len(LABELS) == len(DASHES)


def test_slip_against_speed_and_radius(known, unknown):
    for found, drawn in ((known, 4), (unknown, 0)):
        best = found.comparison.laws["icr_radius"]
        figure = figures.slip_against_speed_and_radius(turns_of(found), best)
        assert bars(figure) == drawn
        assert_units_of_outer_axes(figure)
        assert {"0.60 m", "best law", "Eq. 11"} <= set(labels(figure))


def assert_units_of_outer_axes(figure):
    assert [axis.get_xlabel() for axis in figure.axes[2:]] == ["measured speed v [m/s]", "observed radius R [m]"]
    assert all("[–]" in axis.get_ylabel() for axis in figure.axes[::2])


def test_all_laws_are_drawn_through_the_samples(known, unknown):
    for found, drawn in ((known, 2), (unknown, 0)):
        figure = law_figures.fitted_laws(turns_of(found), found.comparison)
        assert_units(figure)
        assert bars(figure) == drawn
        laws = law_figures.shown_laws(found.comparison)
        assert next(iter(laws)) == found.comparison.ranking[0]
        assert list(laws)[-1] == "published"
        for axis in figure.axes:
            colours = [line.get_color() for line in axis.lines]
            assert all(COLOURS[name] in colours for name in laws)
        shown = labels(figure)
        assert all(any(text.startswith(LABELS[name]) for text in shown) for name in laws)
        assert f"{LABELS['icr_radius']} – best" in shown


def test_residuals_have_a_panel_for_each_law(known, unknown):
    for found, meaning in ((known, "standard errors"), (unknown, "scatter")):
        figure = law_figures.residuals(turns_of(found), found.comparison)
        shown = [axis.get_title(loc="left") for axis in figure.axes if axis.get_visible()]
        assert len(shown) == len(found.comparison.laws) + 1
        assert_units(figure)
        assert len({axis.get_ylim() for axis in figure.axes}) == 1
        assert meaning in labels(figure)[-1]


def test_criteria_stand_side_by_side(known):
    figure = law_figures.criteria(known.comparison)
    assert len(figure.axes) == 4
    assert_units(figure)
    names = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    assert names == [LABELS[name] for name in known.comparison.ranking]
    bold = [text.get_text() for text in figure.axes[0].get_yticklabels() if text.get_fontweight() == "bold"]
    assert bold == [LABELS["icr_radius"]]


def test_criteria_that_are_not_known_are_said_to_be():
    found = identified(driven(grid()[:4], errors=False), ("constant", "icr", "icr_radius"), determined=False)
    figure = law_figures.criteria(found.comparison)
    said = [text.get_text() for axis in figure.axes for text in axis.texts]
    assert said == ["not known"] * 12


def test_correlations_of_the_best_law_and_the_paper_s(known):
    laws = law_figures.correlated_laws(known.comparison)
    assert [law.name for law in laws] == ["icr_radius", "exponential"]
    figure = law_figures.correlations(laws)
    written = [[text.get_text() for text in axis.texts] for axis in figure.axes]
    assert [len(texts) for texts in written] == [4, 16]
    assert written[0][0] == "1"
    assert f"{laws[0].correlation[0, 1]:+.2f}".replace("-", "−") == written[0][1]


def test_a_law_of_one_parameter_has_no_correlations():
    found = identified(driven(grid()), ("icr",), best="icr")
    assert law_figures.correlated_laws(found.comparison) == []
