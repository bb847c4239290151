"""Axes of figures with all grid lines as one line, all marks as another, and ticks copied from the first.

matplotlib makes each tick of five artists, to give it the look of the first one of its axis, and draws each by itself.
"""

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axis import Axis, Tick
from matplotlib.lines import Line2D

PRIVATE = "_update_ticks", "_get_ticklabel_bboxes", "_update_label_position", "_update_offset_text_position"
"""Methods of an axis that are used here."""
_LINES, _LABELS = ("gridline", "tick1line", "tick2line"), ("label1", "label2")


def draw_axis(axis: Any, renderer: Any) -> None:
    """Draw an axis as its own method would, but for the order of its grid lines, marks and labels."""
    if not axis.get_visible():
        return
    renderer.open_group("axis", gid=axis.get_gid())
    ticks = axis._update_ticks()
    boxes = axis._get_ticklabel_bboxes(ticks, renderer)
    straight, shown = axis.axes.name == "rectilinear", set(ticks)
    for alike in (axis.majorTicks, axis.minorTicks):
        drawn = [tick for tick in alike if tick in shown]
        for name in _LINES:
            for together in [drawn] if straight else [[tick] for tick in drawn]:
                if together and (line := getattr(together[0], name)).get_visible():
                    _joined(axis, together, line).draw(renderer)
    for tick in ticks:
        for name in _LABELS:
            getattr(tick, name).draw(renderer)
    axis._update_label_position(renderer)
    axis.label.draw(renderer)
    axis._update_offset_text_position(*boxes)
    axis.offsetText.set_text(axis.major.formatter.get_offset())
    axis.offsetText.draw(renderer)
    renderer.close_group("axis")


def _joined(axis: Any, ticks: Sequence[Tick], line: Line2D) -> Line2D:
    """One line with the marks of all ticks, of which `line` is the first, or with gaps between their grid lines."""
    if len(ticks) == 1:
        return line
    made, level = copy.copy(line), axis.axis_name == "x"
    along: Any = [tick.get_loc() for tick in ticks]
    across: Any = line.get_ydata() if level else line.get_xdata()
    if len(across) > 1:
        along, across = np.repeat(along, len(across) + 1), np.tile([*across, np.nan], len(ticks))
    made.set_data(*((along, across) if level else (across, along)))
    return made


def major_ticks(axis: Axis, numticks: int | None = None) -> list[Tick]:
    """See Axis.get_major_ticks."""
    return _as_many(axis.majorTicks, len(axis.get_majorticklocs()) if numticks is None else numticks)


def minor_ticks(axis: Axis, numticks: int | None = None) -> list[Tick]:
    """See Axis.get_minor_ticks."""
    return _as_many(axis.minorTicks, len(axis.get_minorticklocs()) if numticks is None else numticks)


def _as_many(ticks: list[Tick], count: int) -> list[Tick]:
    """The first `count` ticks of an axis; those that are missing are copied from the first and appended."""
    ticks += [_copied(ticks[0]) for _ in range(count - len(ticks))]
    return ticks[:count]


def _copied(tick: Tick) -> Tick:
    """A tick with artists of its own, which share what is replaced when it changes."""
    made = copy.copy(tick)
    for name in (*_LINES, *_LABELS):
        setattr(made, name, copy.copy(getattr(tick, name)))
    return made
