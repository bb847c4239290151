"""Drawing figures without measuring ticks, texts and axes again and again, in two thirds of the time.

For one file, matplotlib finds the ticks of an axis about ten times, once for every box around them that it asks for,
measures each text for the layout and again for the file, and measures all axes twice for the layout: what surrounds
them might change with their size. Mostly, nothing that all this depends on changes in between.
"""

import functools
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_svg import RendererSVG
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path
from matplotlib.transforms import Bbox

from trackslip.kinematics import Array

_TICKS, _EXTENT, _BOX = "_update_ticks", "get_text_width_height_descent", "get_tightbbox"
_MOST = 4096  # texts remembered


@contextmanager
def quick_drawing() -> Iterator[None]:
    """Remember ticks while limits and places of their axes remain, and the extents of texts in SVG.

    What surrounds axes is remembered for the layout while the texts of their ticks remain. Only layout engines may
    change figures in the block.
    """
    if not hasattr(Axis, _TICKS):  # it is private: another version of matplotlib may lack it
        yield
        return
    find, measure, surround = getattr(Axis, _TICKS), getattr(RendererSVG, _EXTENT), getattr(Axes, _BOX)
    known: dict[Axis, tuple[Any, Any]] = {}

    def ticks(axis: Axis) -> Any:
        if axis not in known or known[axis][0] != _place(axis):
            found = find(axis)  # which may change the limits
            known[axis] = _place(axis), found
        return known[axis][1]

    def extent(_: RendererSVG, text: str, font: FontProperties, ismath: Any) -> Any:
        return _extent(text, font.copy(), ismath)  # a copy, as fonts can be changed

    surrounded: dict[Axes, tuple[list[str], Array]] = {}

    def box(axes: Axes, *arguments: Any, for_layout_only: bool = False, **more: Any) -> Any:
        """The box around axes and all that is attached to them, of which the layout makes margins."""
        if not for_layout_only or axes.get_aspect() != "auto":  # a fixed aspect makes margins change with the size
            return surround(axes, *arguments, for_layout_only=for_layout_only, **more)
        texts = [tick.label1.get_text() for axis in (axes.xaxis, axes.yaxis) for tick in ticks(axis)]
        place = axes.get_position(original=True).transformed(axes.figure.transSubfigure).extents
        if axes in surrounded and surrounded[axes][0] == texts:
            return Bbox.from_extents(*(place + surrounded[axes][1]))
        found = surround(axes, *arguments, for_layout_only=True, **more)
        if found is not None:
            surrounded[axes] = texts, found.extents - place
        return found

    try:
        setattr(Axis, _TICKS, ticks)
        setattr(RendererSVG, _EXTENT, extent)
        setattr(Axes, _BOX, box)
        yield
    finally:
        setattr(Axis, _TICKS, find)
        setattr(RendererSVG, _EXTENT, measure)
        setattr(Axes, _BOX, surround)


def _place(axis: Axis) -> tuple[Any, ...]:
    """What the ticks of an axis depend on: its limits, and the size of its axes on paper."""
    return *axis.get_view_interval(), *axis.axes.bbox.bounds, axis.axes.figure.dpi


@functools.lru_cache(_MOST)
def _extent(text: str, font: FontProperties, ismath: Any) -> Any:
    """Width, height and descent; the renderer of SVG itself asks for nothing else."""
    return text_to_path.get_text_width_height_descent(text, font, ismath)
