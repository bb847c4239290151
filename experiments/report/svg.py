"""SVG files: a text is written as it was before, and all markers of a line at once."""

import functools
import io
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
from matplotlib.backends.backend_svg import FigureCanvasSVG, RendererSVG
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.textpath import text_to_path
from matplotlib.transforms import Affine2D

DPI = 72
"""Points of an SVG file, and of a PDF file, per inch."""
_OURS = "_adjust_glyph_repr", "_convert_path", "_get_clip_attrs", "_get_style_dict", "_glyph_map", "_make_id"
_UNITS = 64  # FreeType's, of which outlines are whole multiples
_MOST = 4096  # texts remembered
_BASE: Any = RendererSVG  # without its types, as it lacks most of them
_TO_PATH: Any = text_to_path
_lines: dict[tuple[Any, ...], tuple[Sequence[str], str]] = {}  # glyphs and elements of texts, by text and font
_outlines: dict[str, str] = {}  # definitions of glyphs, by their names


def svg_of(figure: Figure, salt: str) -> str:
    """The text of an SVG file of a figure that is laid out; `salt` makes its ids differ from those of others."""
    with matplotlib.rc_context({"svg.hashsalt": salt, "svg.fonttype": "path"}):
        renderer = Canvas(figure).get_renderer()
        figure.draw(renderer)
        renderer.finalize()
    return renderer.file.getvalue()


class Canvas(FigureCanvasSVG):
    """What a figure is drawn on, and measured for its layout."""

    def get_renderer(self) -> "_Renderer":
        """A renderer that writes a file of its own."""
        self.figure.dpi = DPI
        return _Renderer(*DPI * self.figure.get_size_inches())


class _Renderer(_BASE):  # type: ignore[misc]
    """Writes all elements of a text, or all markers of a line, at once."""

    def __init__(self, width: float, height: float) -> None:
        self.file = io.StringIO()
        super().__init__(width, height, self.file, image_dpi=DPI, metadata={"Date": None, "Creator": None})
        self._ours = all(hasattr(self, name) for name in _OURS)  # private, another version of matplotlib may lack them
        self._defined: dict[tuple[str, str], str] = {}

    def get_text_width_height_descent(self, s: str, prop: FontProperties, ismath: Any) -> tuple[float, float, float]:
        """Measure a text."""
        return _extent(s, prop.copy(), ismath)  # a copy, as fonts can be changed

    def draw_text(
        self,
        gc: Any,
        x: float,
        y: float,
        s: str,
        prop: FontProperties,
        angle: float,
        ismath: Any = False,
        mtext: Any = None,
    ) -> None:
        """Draw a text as outlines of its letters."""
        if not self._ours or ismath or gc.get_url() or gc.get_forced_alpha() or gc.get_rgb()[3] != 1:
            super().draw_text(gc, x, y, s, prop, angle, ismath, mtext)
            return
        glyphs, elements = self._line(s, prop)
        missing = [glyph for glyph in glyphs if glyph not in self._glyph_map]
        scale = prop.get_size_in_points() / text_to_path.FONT_SCALE
        place = f"translate({x:.6g} {y:.6g}) rotate({-angle:g}) scale({scale:g} {-scale:g})"
        group = self.writer.start("g", self._get_clip_attrs(gc))
        self.writer.start("g", fill=matplotlib.colors.to_hex(gc.get_rgb()), transform=place)
        self.writer.comment(s)
        if missing:
            self._glyph_map.update(dict.fromkeys(missing))
            self.file.write(f"<defs>\n{''.join(_outlines[glyph] for glyph in missing)}</defs>\n")
        self.file.write(elements)
        self.writer.close(group)

    def _line(self, text: str, font: FontProperties) -> tuple[Sequence[str], str]:
        """The names of a text's glyphs, and the elements that place them."""
        look = font.get_style(), font.get_variant(), font.get_weight(), font.get_stretch()
        if (key := (text, *font.get_family(), *look)) not in _lines:
            if len(_lines) == _MOST:
                _lines.clear()
            placed, outlines, _ = _TO_PATH.get_glyphs_with_font(_TO_PATH._get_font(font), text)
            ids = {name: self._adjust_glyph_repr(name) for name in outlines}
            for name, (vertices, codes) in outlines.items():
                path = self._convert_path(Path(vertices * _UNITS, codes), simplify=False)
                _outlines[name] = f'<path id="{ids[name]}" d="{path}" transform="scale({1 / _UNITS})"/>\n'
            elements = (f'<use xlink:href="#{ids[name]}" x="{x:g}" y="{y:g}"/>\n' for name, x, y, _ in placed)
            _lines[key] = tuple(ids), "".join(elements)
        return _lines[key]

    def draw_markers(
        self, gc: Any, marker_path: Path, marker_trans: Any, path: Path, trans: Any, rgbFace: Any = None
    ) -> None:
        """Draw a marker at each vertex of a path."""
        if not self._ours or gc.get_url() or path.codes is not None:
            super().draw_markers(gc, marker_path, marker_trans, path, trans, rgbFace)
            return
        places = trans.transform(path.vertices)
        places[:, 1] = self.height - places[:, 1]
        seen = ((places >= 0) & (places <= (self.width, self.height))).all(axis=1)
        shape = self._convert_path(marker_path, marker_trans + Affine2D().scale(1, -1), simplify=False)
        look = self._get_style_dict(gc, rgbFace)
        stroke = _css({key: value for key, value in look.items() if key.startswith("stroke")})
        name = self._defined.get((shape, stroke))
        if name is None:
            name = self._defined[shape, stroke] = self._make_id("m", (shape, stroke))
            self.writer.start("defs")
            self.writer.element("path", id=name, d=shape, style=stroke)
            self.writer.end("defs")
        self.writer.start("g", self._get_clip_attrs(gc), style=_css(look))
        self.writer.comment("markers")
        self.file.writelines(f'<use xlink:href="#{name}" x="{x:.6g}" y="{y:.6g}"/>\n' for x, y in places[seen].tolist())
        self.writer.end("g")


def _css(look: Mapping[str, str]) -> str:
    return "; ".join(f"{key}: {value}" for key, value in look.items())


@functools.lru_cache(_MOST)
def _extent(text: str, font: FontProperties, ismath: Any) -> tuple[float, float, float]:
    """Width, height and descent of a text."""
    return text_to_path.get_text_width_height_descent(text, font, ismath)
