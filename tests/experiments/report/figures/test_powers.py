"""Powers of ten as plain text."""

import pytest
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from experiments.report.figures.powers import plain, print_plain_powers


def labels(axis):
    axis.figure.draw_without_rendering()
    return [text.get_text() for which in ("major", "minor") for text in axis.get_ticklabels(which=which)]


@pytest.mark.parametrize(
    ("formula", "text"),
    [
        (r"$\mathdefault{10^{-3}}$", "10⁻³"),
        (r"$\mathdefault{-10^{12}}$", "−10¹²"),
        (r"$\mathdefault{2\times10^{-4}}$", "2×10⁻⁴"),
        (r"$\mathdefault{0}$", "0"),
        ("", ""),
    ],
)
def test_formulas_become_text(formula, text):
    assert plain(formula) == text


@pytest.mark.parametrize("limits", [(1e-4, 1e2), (2e-3, 9e-3), (0.5, 30.0)])
def test_the_ticks_that_matplotlib_labels_have_its_labels(limits):
    before, after = Figure().subplots(1, 2)
    for axes in (before, after):
        axes.set(yscale="log", ylim=limits)
    print_plain_powers(after.yaxis)
    shown = labels(after.yaxis)
    assert shown == [plain(label) for label in labels(before.yaxis)]
    assert any(shown)
    assert not any(character in label for label in shown for character in "$\\^{")


def test_symmetrical_axes_have_both_signs():
    axes = Figure().subplots()
    axes.set_yscale("symlog", linthresh=0.01)
    axes.set_ylim(-1, 1)
    print_plain_powers(axes.yaxis)
    assert {"−10⁻¹", "0", "10⁻¹"} <= set(labels(axes.yaxis))
    assert isinstance(axes.yaxis.get_minor_formatter(), NullFormatter)
