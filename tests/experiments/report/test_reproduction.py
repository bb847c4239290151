"""The page of an identification: tables, text and figures of whatever there is data for."""

import html
import re

import numpy as np
import pytest
from identified import driven, grid, identified
from spin import spun_before_the_scanner

from experiments.measuring.grid import RadiusSummary
from experiments.measuring.inner_outer import InnerOuterSamples
from experiments.measuring.paper_comparison import Quantity
from experiments.report.figures.laws import fitted_laws
from experiments.report.figures.steady_runs import slip_against_speed_and_radius
from experiments.report.laws import shown
from experiments.report.reproduction import Report, render
from trackslip.slip.exponential import PUBLISHED

OF_LAWS = (
    "fig05_slip_over_speed_and_radius",
    "fig06_slip_laws",
    "residuals_of_laws",
    "comparison_of_laws",
    "correlations_of_parameters",
)


def page_of(found, **more):
    page = render(
        Report(
            title="Laws",
            command="trackslip identify",
            manifest={},
            identification=found,
            **more,
        )
    )
    assert [drawing.name for drawing in page.drawings] == figures_in(page.html)
    return page.html


def figures_in(page):
    return re.findall(r'<figure id="(\w+)"', page)


def text_of(page):
    """The page's words, without figures and tags."""
    bare = re.sub(r"<svg.*?</svg>|<style>.*?</style>|<[^>]*>", " ", page, flags=re.DOTALL)
    return html.unescape(" ".join(bare.split()))


@pytest.fixture(scope="module")
def page():
    found = identified(driven(grid()), outliers=[("run 9", "it is 0.3 off")])
    return page_of(found, grid_logs=[spun_before_the_scanner(400)])


def test_every_figure_is_there(page):
    expected = ["fig04_pose_and_velocity", "localization_error", *OF_LAWS]
    assert figures_in(page) == expected
    assert page.count("<svg") == len(expected)
    assert "data:image" not in page  # a bitmap would not survive the renaming of ids


def test_tables_show_every_law_with_errors_intervals_and_criteria(page):
    words = text_of(page)
    for name in ("none", "constant", "exponential", "icr", "icr_radius", "published"):
        assert words.count(shown(name).title) >= 2
    assert re.search(r"D \d+\.\d+ ± \d\.\d+ mm \d+\.\d+ to \d+\.\d+", words)
    assert re.search(r"ε 0\.\d+ ± 0\.\d+ % 0\.\d+ to", words)
    assert "constant ICR with ε best" in words
    for heading in ("95 % interval", "AICc above least", "radius: yaw rate [mrad/s]", "Lack of fit"):
        assert heading in words
    assert re.search(r"misses F\(\d+, \d+\) = \d+, p < 0\.001", words)


def test_words_carry_the_numbers_of_the_data(page):
    words = text_of(page)
    assert "Each of 8 runs" in words
    assert re.search(
        r"best law here is constant ICR with ε , with 2 parameters\. It leaves a residual of 0\.\d+", words
    )
    assert re.search(r"enlarged \d+ times", words)
    assert re.search(r"multiplied by \d", words)
    assert "run 9 : it is 0.3 off." in words
    assert words.count("it is 0.3 off") == 1  # not among the warnings as well
    assert "law power: the samples don't determine beta_outer." in words


def test_samples_without_errors_say_so():
    words = text_of(page_of(identified(driven(grid(), errors=False))))
    assert "There are no error bars because the samples came without errors of measurement." in words
    assert "twice the scatter about the best law" in words


def test_few_samples_render_without_criteria_bootstrap_or_test():
    samples = driven([(0.1, 0.1), (0.1, 0.2)], errors=False)
    found = identified(samples, ("constant", "icr", "icr_radius"), determined=False)
    words = text_of(page_of(found))
    assert "Lack of fit cannot be tested here" in words
    assert "too few samples for the criterion" in words
    assert "nan" not in words.lower().split()


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
def test_all_kinds_of_turns_render(twists):
    page = page_of(identified(driven(twists), ("icr", "icr_radius")))
    assert figures_in(page) == list(OF_LAWS)


def test_straight_runs_alone_have_tables_but_no_axis_of_radii():
    samples = driven([(0.1, 0.0), (0.2, 0.0), (0.15, 0.0)])
    page = page_of(identified(samples, ("none",), best="none"))
    assert figures_in(page)[0] == "comparison_of_laws"
    assert "3 of them were nearly straight" in text_of(page)


@pytest.mark.parametrize("twists", [grid(), [(0.1, 0.1 / radius) for radius in (0.5, 1.0, 2.0, 3.0)]])
def test_published_and_simulated_says_how_far_runs_are_apart(twists):
    found = identified(driven(twists))
    radius = RadiusSummary((0.5, 1.0), np.array([0.63, np.nan]), np.array([0.62, 1.34]), 0.01)
    rows = [Quantity("slip minus Eq. 11, rms", (), (0.01,)), Quantity("  at other radii", (), (0.02,))]
    page = render(Report(title="", command="", manifest={}, radius=radius, comparison=rows, identification=found)).html
    words = text_of(page)
    apart = re.findall(r"differ by at most (0\.\d+) \(inner track\) and (0\.\d+) \(outer track\)\.", words)
    again = re.findall(r"differs between runs by at most (0\.\d+) \(inner\) and (0\.\d+) \(outer\)", words)
    assert apart == again
    assert len(apart) == (len(twists) > 4)  # only where runs share a radius
    assert '<th scope="row">  at other radii' in page
    assert re.search(r"\.indented tbody th { white-space: pre-wrap; }", page)


def test_one_run_is_spoken_of_as_one():
    found = identified(driven([(0.1, 0.08)]), ("icr",), best="icr", determined=False)
    words = text_of(page_of(found))
    assert "The only run gives one mean slip per track, at observed radii of 1.25 m and speeds of 0.10 m/s" in words
    assert "tracks of the only run at once" in words
    assert "the radii are scattered" not in words
    turns = InnerOuterSamples.of(found.samples, found.geometry)
    names = [text.get_text() for legend in slip_against_speed_and_radius(turns, found.comparison.laws["icr"]).legends
             for text in legend.get_texts()]  # fmt: skip
    assert "best law" in names
    for axis, track in zip(fitted_laws(turns, found.comparison).axes, (1, 0), strict=False):
        low, high = axis.get_ylim()
        for law in (found.comparison.laws["icr"].law, PUBLISHED):
            assert low < (turns.slip - turns.residual(law))[0, track] < high
