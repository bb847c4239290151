"""SVG files: a text is written as it was before, and all markers of a line at once."""

import io
from collections.abc import Mapping
from typing import Any

import matplotlib
from matplotlib.backends.backend_svg import FigureCanvasSVG, RendererSVG
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.textpath import text_to_path
from matplotlib.transforms import Affine2D

from experiments.report.glyphs import KNOWN, SIZE, UNITS, Glyph, line_of

DPI = 72
"""Points of an SVG file, and of a PDF file, per inch."""
# Private names, which another version of matplotlib may lack.
_OURS = "_adjust_glyph_repr", "_convert_path", "_get_clip_attrs", "_get_style_dict", "_glyph_map", "_make_id"
_BASE: Any = RendererSVG  # without its types, as it lacks most of them
_definitions: dict[str, str] = {}  # of glyphs, by their names


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
        self._text2path = text_to_path  # one for all files, as it remembers formulas
        self._ours = KNOWN and set(_OURS) <= set(dir(self))
        self._defined: dict[tuple[str, str], str] = {}

    def get_text_width_height_descent(self, s: str, prop: FontProperties, ismath: Any) -> tuple[float, float, float]:
        """Measure a text."""
        if ismath or not KNOWN or not s:
            return super().get_text_width_height_descent(s, prop, ismath)
        scale = prop.get_size_in_points() / SIZE
        width, height, descent = line_of(s, prop).extent
        return width * scale, height * scale, descent * scale

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
        line = line_of(s, prop)
        missing = {glyph.name: glyph for glyph in line.glyphs if glyph.name not in self._glyph_map}
        scale = prop.get_size_in_points() / SIZE
        place = f"translate({x:.6g} {y:.6g}) rotate({-angle:g}) scale({scale:g} {-scale:g})"
        group = self.writer.start("g", self._get_clip_attrs(gc))
        self.writer.start("g", fill=matplotlib.colors.to_hex(gc.get_rgb()), transform=place)
        self.writer.comment(s)
        if missing:
            self._glyph_map.update(missing)
            self.file.write(f"<defs>\n{''.join(map(self._definition, missing.values()))}</defs>\n")
        self.file.writelines(
            f'<use xlink:href="#{self._adjust_glyph_repr(glyph.name)}" x="{right:g}" y="{up:g}"/>\n'
            for glyph, (right, up) in zip(line.glyphs, line.places, strict=True)
        )
        self.writer.close(group)

    def _definition(self, glyph: Glyph) -> str:
        """The element of a glyph's outline, to be used again and again."""
        if glyph.name not in _definitions:
            path = self._convert_path(glyph.outline, simplify=False)
            name = self._adjust_glyph_repr(glyph.name)
            _definitions[glyph.name] = f'<path id="{name}" d="{path}" transform="scale({1 / UNITS:g})"/>\n'
        return _definitions[glyph.name]

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
