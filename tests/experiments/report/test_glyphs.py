"""Lines of text are as long and as high as matplotlib says, and their letters stand where it puts them."""

import numpy as np
import pytest
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path

from experiments.report.glyphs import KNOWN, SIZE, UNITS, line_of

pytestmark = pytest.mark.skipif(not KNOWN, reason="matplotlib before 3.11 lays lines out in another way")
TEXTS = ("observed radius R [m]", "AVATo.", "−0.05", "2×10⁻³", "'", " ", "− ", "jf", "difficult", "±‖φ‖")


@pytest.mark.parametrize("text", TEXTS)
@pytest.mark.parametrize("weight", ["normal", "bold"])
def test_a_line_is_as_matplotlib_has_it(text, weight):
    font = FontProperties(size=SIZE, weight=weight)
    line = line_of(text, font)
    assert line.extent == text_to_path.get_text_width_height_descent(text, font, False)
    vertices = [glyph.outline.vertices / UNITS + place for glyph, place in zip(line.glyphs, line.places, strict=True)]
    expected, _ = text_to_path.get_text_path(font, text)
    np.testing.assert_allclose(np.concatenate(vertices), np.reshape(expected, (-1, 2)))
