"""Lines of text as glyphs: matplotlib lays each out to measure it and again to draw it, and loads each letter twice."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.font_manager import FontProperties
from matplotlib.ft2font import FT2Font, LoadFlags
from matplotlib.path import Path
from matplotlib.textpath import text_to_path

SIZE = text_to_path.FONT_SCALE
"""Size of the font in which glyphs are laid out [points]."""
UNITS = 64
"""Outlines are whole multiples of a point over this number."""
_TO_PATH: Any = text_to_path
_PRIVATE = (_TO_PATH, "_get_font"), (_TO_PATH, "_get_glyph_repr"), (FT2Font, "_layout")
KNOWN = all(hasattr(owner, name) for owner, name in _PRIVATE)
"""Whether this version of matplotlib has what is used here."""
_MOST = 4096  # lines remembered


@dataclass(frozen=True)
class Glyph:
    """A letter of a font at SIZE."""

    name: str
    """Of the font and of the letter in it, unique."""
    outline: Path
    """In multiples of a point over UNITS."""
    advance: float
    """From its origin to that of the next letter [points]."""
    low: float
    """The lowest point above the line, negative below it [points]."""
    high: float
    """The highest point above the line [points]."""


@dataclass(frozen=True)
class Line:
    """A line of text at SIZE."""

    glyphs: Sequence[Glyph]
    places: Sequence[tuple[float, float]]
    """Of their origins, to the right and up [points]."""

    @property
    def extent(self) -> tuple[float, float, float]:
        """Width, height and descent [points]."""
        low = min(glyph.low + y for glyph, (_, y) in zip(self.glyphs, self.places, strict=True))
        high = max(glyph.high + y for glyph, (_, y) in zip(self.glyphs, self.places, strict=True))
        return self.places[-1][0] + self.glyphs[-1].advance, high - low, -low


_lines: dict[tuple[Any, ...], Line] = {}
_glyphs: dict[tuple[str, int], Glyph] = {}


def line_of(text: str, font: FontProperties) -> Line:
    """The glyphs of a text that isn't empty, in a font whose size doesn't matter."""
    key = text, *font.get_family(), font.get_style(), font.get_variant(), font.get_weight(), font.get_stretch()
    if key not in _lines:
        if len(_lines) == _MOST:
            _lines.clear()
        laid_out = _TO_PATH._get_font(font)._layout(text, LoadFlags.NO_HINTING)
        glyphs = tuple(_glyph(item.ft_object, item.glyph_index) for item in laid_out)
        _lines[key] = Line(glyphs, tuple((item.x, item.y) for item in laid_out))
    return _lines[key]


def _glyph(font: Any, index: int) -> Glyph:
    key = font.postscript_name, index
    if key not in _glyphs:
        loaded = font.load_glyph(index, flags=LoadFlags.NO_HINTING)
        vertices, codes = font.get_path()
        _, low, _, high = loaded.bbox
        name = _TO_PATH._get_glyph_repr(font, index)
        outline = Path(vertices * UNITS, codes)
        _glyphs[key] = Glyph(name, outline, loaded.horiAdvance / UNITS, low / UNITS, high / UNITS)
    return _glyphs[key]
