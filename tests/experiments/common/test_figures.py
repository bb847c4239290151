"""Figures of tracking and of predictions, and legibility: contrast on the light and dark page, and without colour."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from figures import assert_readable, legend_texts
from identifications import GEOMETRY, driven, grid, identified
from matplotlib.colors import to_rgb

import experiments
from experiments.common import colours
from experiments.common.laws import law_looks, shown
from experiments.common.style import RADII_SHADES, SPEED_SHADES, shade
from experiments.predict import _MODULI, draw_prediction
from experiments.simulate import tracking_figures as figures
from experiments.simulate.paper_model import published_runs
from trackslip.metrics import body_errors
from trackslip.skid_theory import Load, line_contact, steady_turns
from trackslip.trajectory.segmented import paper_reference

START = {"feedforward": paper_reference().pose(0.0), "linear": np.array([0.3, -0.2, np.pi / 3])}


@pytest.fixture(scope="module")
def published():
    return published_runs(START, GEOMETRY)


def test_paths_and_errors_are_those_of_the_runs(published):
    log = published["linear"]["none"]
    ground, _ = assert_readable(figures.paths(published["linear"], published["linear"])).axes
    (line,) = [line for line in ground.lines if line.get_label() == shown("none").label]
    assert (line.get_xdata()[0], line.get_ydata()[0]) == pytest.approx(tuple(log.pose[0, :2]))
    line = assert_readable(figures.tracking_errors_over_time({"none": log}, {})).axes[0].lines[0]
    rows = np.searchsorted(log.time, line.get_xdata())
    expected = body_errors(log.pose, paper_reference().pose(log.time))[rows, 0]
    np.testing.assert_allclose(line.get_ydata(), expected)


def test_slip_of_compensations_whose_law_is_known(published):
    runs = published["linear"]
    laws = identified(driven(grid()), ("icr", "icr_radius")).comparison.laws
    figure = assert_readable(figures.slip_during_tracking(runs | {"icr_radius": runs["published"]}, laws, runs))
    assert len(figure.axes) == 2
    assert "right track, from the law" in legend_texts(figure)
    silent = {name: replace(log, twist_command=None) for name, log in runs.items()}
    assert figures.slip_during_tracking(silent, laws, {}) is None


def test_a_prediction_has_a_line_for_each_modulus_and_a_point_for_each_radius():
    contact, load = line_contact(0.168, 0.17, 0.7, 0.778), Load()
    turns = steady_turns((0.6, 1.5, 3.0), contact, 0.01, load)
    offset, slip = assert_readable(draw_prediction(turns, contact, 0.01, load)).axes
    *lines, points = offset.lines
    assert len(lines) == len(_MODULI)
    np.testing.assert_allclose(points.get_ydata(), 1e3 * turns.offset)
    np.testing.assert_allclose(slip.lines[-2].get_ydata(), turns.slip[:, 1])


MIN_CONTRAST = 3.0  # WCAG 2.1, success criterion 1.4.11: graphical objects
TEMPLATE = (Path(experiments.__file__).parent / "common" / "page.html.j2").read_text(encoding="utf-8")
# the filter hue-rotate(180deg) of CSS, as the Filter Effects specification gives it
HUE_ROTATE = np.array([[0.213, 0.715, 0.072]] * 3) - (np.eye(3) - np.array([[0.213, 0.715, 0.072]] * 3))


def in_the_dark(colour):
    """A figure's colour after the style sheet's filter for the dark page."""
    amount = float(re.search(r"filter: invert\(([\d.]+)\) hue-rotate\(180deg\)", TEMPLATE)[1])
    inverted = amount - (2 * amount - 1) * np.array(to_rgb(colour))
    return np.clip(HUE_ROTATE @ inverted, 0, 1)


def luminance(colour):
    rgb = np.array(to_rgb(colour))
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722]


def contrast(a, b):
    dark, light = sorted([luminance(a), luminance(b)])
    return (light + 0.05) / (dark + 0.05)


def test_a_figures_white_becomes_the_dark_cards_colour():
    card = re.search(r"dark\) \{\s*\.card \{ background: (#\w+)", TEMPLATE)[1]
    np.testing.assert_allclose(in_the_dark("white"), to_rgb(card), atol=0.005)


@pytest.mark.parametrize(
    "colour",
    [
        *(value for name in ("BLUE", "ORANGE", "GREEN", "RED", "BLACK", "GREY") if (value := vars(colours)[name])),
        *(law.colour for law in law_looks().values()),
        *(shade(shades, share) for shades in (RADII_SHADES, SPEED_SHADES) for share in np.linspace(0, 1, 9)),
    ],
    ids=str,
)
def test_lines_and_symbols_stand_out_from_the_page(colour):
    assert contrast(colour, "white") >= MIN_CONTRAST - 0.005
    assert contrast(in_the_dark(colour), in_the_dark("white")) >= MIN_CONTRAST


def test_laws_differ_without_colour():
    assert len({str(law.dashes) for law in law_looks().values()}) == len(law_looks())
