"""Drawing figures without measuring ticks, texts and axes again and again, in half of the time.

For one file, matplotlib finds the ticks of an axis about ten times, once for every box around them that it asks for,
measures each text for the layout and again for the file, and measures all axes twice for the layout: what surrounds
them might change with their size. Mostly, nothing that all this depends on changes in between. It also makes each tick
anew, with five artists, to give it the look of the first one of its axis.
"""

import copy
import functools
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from matplotlib.axes import Axes
from matplotlib.axis import Axis, Tick
from matplotlib.backends.backend_svg import RendererSVG
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path
from matplotlib.transforms import Bbox

from trackslip.kinematics import Array

_TICKS, _EXTENT, _BOX = "_update_ticks", "get_text_width_height_descent", "get_tightbbox"
_PARTS = "tick1line", "tick2line", "gridline", "label1", "label2"
_MOST = 4096  # texts remembered


@contextmanager
def quick_drawing() -> Iterator[None]:
    """Remember ticks while limits and places of their axes remain, and the extents of texts in SVG; copy ticks.

    What surrounds axes is remembered for the layout while the texts of their ticks remain. Only layout engines may
    change figures in the block.
    """
    if not hasattr(Axis, _TICKS):  # it is private: another version of matplotlib may lack it
        yield
        return
    find, surround = getattr(Axis, _TICKS), getattr(Axes, _BOX)
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

    ours = (
        (Axis, _TICKS, ticks),
        (RendererSVG, _EXTENT, extent),
        (Axes, _BOX, box),
        (Axis, "get_major_ticks", _major_ticks),
        (Axis, "get_minor_ticks", _minor_ticks),
    )
    theirs = [(owner, name, getattr(owner, name)) for owner, name, _ in ours]
    try:
        for owner, name, function in ours:
            setattr(owner, name, function)
        yield
    finally:
        for owner, name, function in theirs:
            setattr(owner, name, function)


def _major_ticks(axis: Axis, numticks: int | None = None) -> list[Tick]:
    return _as_many(axis.majorTicks, len(axis.get_majorticklocs()) if numticks is None else numticks)


def _minor_ticks(axis: Axis, numticks: int | None = None) -> list[Tick]:
    return _as_many(axis.minorTicks, len(axis.get_minorticklocs()) if numticks is None else numticks)


def _as_many(ticks: list[Tick], count: int) -> list[Tick]:
    """The first `count` ticks of an axis; those that are missing are copied from the first and appended."""
    ticks += [_copied(ticks[0]) for _ in range(count - len(ticks))]
    return ticks[:count]


def _copied(tick: Tick) -> Tick:
    """A tick with artists of its own, which share what is replaced when it changes."""
    made = copy.copy(tick)
    for name in _PARTS:
        setattr(made, name, copy.copy(getattr(tick, name)))
    return made


def _place(axis: Axis) -> tuple[Any, ...]:
    """What the ticks of an axis depend on: its limits, and the size of its axes on paper."""
    return *axis.get_view_interval(), *axis.axes.bbox.bounds, axis.axes.figure.dpi


@functools.lru_cache(_MOST)
def _extent(text: str, font: FontProperties, ismath: Any) -> Any:
    """Width, height and descent; the renderer of SVG itself asks for nothing else."""
    return text_to_path.get_text_width_height_descent(text, font, ismath)
