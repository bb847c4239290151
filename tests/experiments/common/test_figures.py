"""Legibility of figures: contrast on the light and dark page, and without colour."""

import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb

import experiments
from experiments.common import colours
from experiments.common.laws import law_looks
from experiments.common.style import RADII_SHADES, SPEED_SHADES, shade

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
