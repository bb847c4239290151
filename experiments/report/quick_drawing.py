"""Drawing figures without measuring ticks, texts and axes again and again, in a quarter of the time (with `svg`).

For one file, matplotlib finds the ticks of an axis about ten times, once for every box around them that it asks for,
lays each text out five times, and measures all axes twice for the layout: what surrounds them might change with their
size. Mostly, nothing that all this depends on changes in between.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.spines import Spine
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from experiments.report.quick_axis import PRIVATE, draw_axis, major_ticks, minor_ticks
from trackslip.kinematics import Array

_BOX, _TICKS, _LABELS = "get_tightbbox", "_update_ticks", "_get_ticklabel_bboxes"
_LIMITS, _LAYOUT = "_unstale_viewLim", "_get_layout"
_NEEDED = {Axis: {_TICKS, *PRIVATE}, Axes: {_LIMITS}, Text: {_LAYOUT}}  # another version of matplotlib may lack them
_EXACT = 6  # decimals of a size [pixels]; rounding must not count as a change


@contextmanager
def quick_drawing() -> Iterator[None]:
    """Remember what is measured while nothing that it depends on changes; draw the ticks of an axis together.

    What surrounds axes is remembered for the layout while the texts of their ticks remain. Only layout engines may
    change figures in the block.
    """
    if any(names - set(dir(owner)) for owner, names in _NEEDED.items()):
        yield
        return
    ours = (
        (Axes, _BOX, _box()),
        (Axes, _LIMITS, _remembered(getattr(Axes, _LIMITS), lambda axes: None)),
        (Spine, "get_window_extent", _remembered(Spine.get_window_extent, lambda spine: _place(spine.axes))),
        (Text, _LAYOUT, _remembered(getattr(Text, _LAYOUT), _look)),
        (Axis, _TICKS, _remembered(getattr(Axis, _TICKS), lambda axis: _size(axis.axes))),
        (Axis, _LABELS, _remembered(getattr(Axis, _LABELS), lambda axis: _place(axis.axes))),
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


def _remembered(find: Callable[..., Any], state: Callable[[Any], Any]) -> Callable[..., Any]:
    """The same method of a class, which calls `find` only if an object's `state` has changed since the last call."""
    known: dict[Any, tuple[Any, Any]] = {}

    def found(one: Any, *arguments: Any, **more: Any) -> Any:
        if one not in known or known[one][0] != state(one):
            value = find(one, *arguments, **more)  # which may change the state: ticks may change the limits
            known[one] = state(one), value
        return known[one][1]

    return found


def _size(axes: Any) -> tuple[Any, ...]:
    """What ticks depend on: the limits of their axes, and the size on paper."""
    _, _, width, height = axes.bbox.bounds
    return *axes.viewLim.extents.tolist(), round(width, _EXACT), round(height, _EXACT), axes.figure.dpi


def _place(axes: Any) -> tuple[Any, ...]:
    """What the places of texts and spines depend on."""
    return *axes.viewLim.extents.tolist(), *axes.bbox.bounds, axes.figure.dpi


def _look(text: Any) -> tuple[Any, ...]:
    """What the boxes of a text and its lines depend on, if they are about its anchor."""
    about = text.get_horizontalalignment(), text.get_verticalalignment()
    return text.get_text(), text.get_rotation(), *about, text.figure.dpi


def _box() -> Callable[..., Any]:
    """Axes.get_tightbbox: the box around axes and all that is attached to them, of which the layout makes margins."""
    surround, known = getattr(Axes, _BOX), dict[Axes, tuple[list[str], Array]]()

    def box(axes: Any, *arguments: Any, for_layout_only: bool = False, **more: Any) -> Any:
        if not for_layout_only or axes.get_aspect() != "auto":  # a fixed aspect makes margins change with the size
            return surround(axes, *arguments, for_layout_only=for_layout_only, **more)
        texts = [tick.label1.get_text() for axis in (axes.xaxis, axes.yaxis) for tick in axis._update_ticks()]
        place = axes.get_position(original=True).transformed(axes.figure.transSubfigure).extents
        if axes in known and known[axes][0] == texts:
            return Bbox.from_extents(*(place + known[axes][1]))
        found = surround(axes, *arguments, for_layout_only=True, **more)
        if found is not None:
            known[axes] = texts, found.extents - place
        return found

    return box
