"""Drawing figures without measuring ticks, texts and axes again and again, in half of the time.

For one file, matplotlib finds the ticks of an axis about ten times, once for every box around them that it asks for,
lays each text out five times, and measures all axes twice for the layout: what surrounds them might change with their
size. Mostly, nothing that all this depends on changes in between.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from experiments.report.quick_axis import PRIVATE, draw_axis, major_ticks, minor_ticks
from trackslip.kinematics import Array

_TICKS, _LAYOUT, _BOX = "_update_ticks", "_get_layout", "get_tightbbox"
_PRIVATE = {Axis: {_TICKS, *PRIVATE}, Text: {_LAYOUT}}  # names that another version of matplotlib may lack


@contextmanager
def quick_drawing() -> Iterator[None]:
    """Remember ticks while limits and places of their axes remain, and how texts are laid out; draw ticks together.

    What surrounds axes is remembered for the layout while the texts of their ticks remain. Only layout engines may
    change figures in the block.
    """
    if any(names - set(dir(owner)) for owner, names in _PRIVATE.items()):
        yield
        return
    find, surround, lay_out = getattr(Axis, _TICKS), getattr(Axes, _BOX), getattr(Text, _LAYOUT)
    known: dict[Axis, tuple[Any, Any]] = {}
    surrounded: dict[Axes, tuple[list[str], Array]] = {}
    laid_out: dict[Text, tuple[Any, Any]] = {}

    def ticks(axis: Axis) -> Any:
        if axis not in known or known[axis][0] != _place(axis):
            found = find(axis)  # which may change the limits
            known[axis] = _place(axis), found
        return known[axis][1]

    def layout(text: Any, renderer: Any) -> Any:
        """The boxes of a text and its lines, about its anchor."""
        about = text.get_horizontalalignment(), text.get_verticalalignment()
        look = text.get_text(), text.get_rotation(), *about, text.figure.dpi
        if text not in laid_out or laid_out[text][0] != look:
            laid_out[text] = look, lay_out(text, renderer)
        return laid_out[text][1]

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
        (Text, _LAYOUT, layout),
        (Axes, _BOX, box),
        (Axis, "draw", draw_axis),
        (Axis, "get_major_ticks", major_ticks),
        (Axis, "get_minor_ticks", minor_ticks),
    )
    theirs = [(owner, name, getattr(owner, name)) for owner, name, _ in ours]
    try:
        for owner, name, function in ours:
            setattr(owner, name, function)
        yield
    finally:
        for owner, name, function in theirs:
            setattr(owner, name, function)


def _place(axis: Axis) -> tuple[Any, ...]:
    """What the ticks of an axis depend on: its limits, and the size of its axes on paper."""
    return *axis.get_view_interval(), *axis.axes.bbox.bounds, axis.axes.figure.dpi
