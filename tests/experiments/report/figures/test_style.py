"""Whether figures can be seen: contrast on the light page and the dark one, and without colour."""

import re
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from figures import assert_readable
from matplotlib.colors import to_rgb

import experiments
from experiments.benchmark.page import controller_line
from experiments.report import colours
from experiments.report.figures.style import RADII_SHADES, SPEED_SHADES, key, legend_below, shade, styled, subplots
from experiments.report.laws import law_looks

MIN_CONTRAST = 3.0  # WCAG 2.1, success criterion 1.4.11: graphical objects
TEMPLATE = (Path(experiments.__file__).parent / "report" / "templates" / "page.html.j2").read_text(encoding="utf-8")
# the filter hue-rotate(180deg) of CSS, as the Filter Effects specification gives it
HUE_ROTATE = np.array([[0.213, 0.715, 0.072]] * 3) - (np.eye(3) - np.array([[0.213, 0.715, 0.072]] * 3))


def in_the_dark(colour):
    """What the style sheet makes of a figure's colour on the dark page."""
    amount = float(re.search(r"filter: invert\(([\d.]+)\) hue-rotate\(180deg\)", TEMPLATE)[1])
    inverted = amount - (2 * amount - 1) * np.array(to_rgb(colour))
    return np.clip(HUE_ROTATE @ inverted, 0, 1)


def luminance(colour):
    rgb = np.array(to_rgb(colour))
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722]


def contrast(a, b):
    dark, light = sorted([luminance(a), luminance(b)])
    return (light + 0.05) / (dark + 0.05)


def test_the_measure_of_contrast():
    assert contrast("white", "black") == pytest.approx(21)
    assert contrast("#767676", "white") == pytest.approx(4.54, abs=0.01)  # the greyest text that WCAG allows


def test_a_figures_white_becomes_the_dark_cards_colour():
    card = re.search(r"dark\) \{\s*\.card \{ background: (#\w+)", TEMPLATE)[1]
    np.testing.assert_allclose(in_the_dark("white"), to_rgb(card), atol=0.005)


@pytest.mark.parametrize(
    "colour",
    [
        *(value for name in ("BLUE", "ORANGE", "GREEN", "RED", "BLACK", "GREY") if (value := vars(colours)[name])),
        *(law.colour for law in law_looks().values()),
        *(controller_line(k)["color"] for k in range(10)),
        *(shade(shades, share) for shades in (RADII_SHADES, SPEED_SHADES) for share in np.linspace(0, 1, 9)),
    ],
    ids=str,
)
def test_lines_and_symbols_stand_out_from_the_page(colour):
    assert contrast(colour, "white") >= MIN_CONTRAST - 0.005
    assert contrast(in_the_dark(colour), in_the_dark("white")) >= MIN_CONTRAST


def test_laws_differ_without_colour():
    assert len({str(law.dashes) for law in law_looks().values()}) == len(law_looks())
    looks = [controller_line(k) for k in range(70)]
    assert len({(look["color"], str(look["linestyle"])) for look in looks}) == 70
    assert len({str(look["linestyle"]) for look in looks[:7]}) == 7


def test_no_figure_has_a_colour_of_its_own_too_pale_to_see():
    pale = re.compile(r'color="(#[0-9A-Fa-f]{6})"')
    for file in Path(experiments.__file__).parent.rglob("*.py"):
        for colour in pale.findall(file.read_text(encoding="utf-8")):
            assert contrast(colour, "white") >= MIN_CONTRAST, f"{file.name}: {colour}"


def test_shades_end_where_they_still_can_be_seen():
    name, top = RADII_SHADES
    assert shade(RADII_SHADES, 1.0) == matplotlib.colormaps[name](top)


def test_margins_and_gaps_are_as_asked_for():
    figure, axes = subplots(4.0, 2, 3, left=1.0, across=0.4, down=0.5)
    size = figure.get_size_inches()
    boxes = [axis.get_position() for axis in axes.ravel()]
    assert boxes[0].x0 * size[0] == pytest.approx(1.0)
    assert (boxes[1].x0 - boxes[0].x1) * size[0] == pytest.approx(0.4)
    assert (boxes[0].y0 - boxes[3].y1) * size[1] == pytest.approx(0.5)


@pytest.mark.parametrize("entries", [1, 3, 4, 12])
def test_a_legend_below_makes_the_figure_higher_and_leaves_the_axes_alone(entries):
    @styled
    def draw(entries):
        figure, axes = subplots(3.0)
        axes.set_xlabel("time [s]")
        if entries:
            legend_below(figure, [key(f"law {k}") for k in range(entries)])
        return assert_readable(figure)

    without, figure = (draw(count).axes[0].get_window_extent() for count in (0, entries))
    assert (figure.width, figure.height) == pytest.approx((without.width, without.height))
