"""The figure of localization: errors against the angle at which the scanner sees the plate."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from experiments.common.colours import BLUE, GREEN, ORANGE
from experiments.common.style import legend_below, log_ticks, mark_span, styled, subplots
from experiments.identify.sightings import Sightings
from trackslip.localization.bound import MIN_ANGLE
from trackslip.metrics import rms

_EDGES = np.radians([0, 1, 2, 3, 5, 8, 12, 18, 26, 34, 42, 50, 58, 66, 74, 82, 90])
_MIN_POSES = 10  # poses per bin, at least


@styled
def error_against_viewing_angle(seen: Sightings) -> Figure:
    """Root mean square errors of position and heading in bins of the viewing angle, with the Cramér-Rao bound."""
    figure, (position, heading) = subplots(3.9, 1, 2)
    which = np.clip(np.digitize(seen.angle, _EDGES) - 1, 0, _EDGES.size - 2)
    held = seen.measured & np.isfinite(seen.bound).all(axis=1)
    bins = [rows for k in range(_EDGES.size - 1) if (rows := np.flatnonzero((which == k) & held)).size >= _MIN_POSES]
    angle, least = np.degrees([seen.angle[rows].mean() for rows in bins]), float(np.degrees(MIN_ANGLE))
    for column, (axis, factor, name, colour, marker) in enumerate((
        (position, 1e3, "along the line of sight", BLUE, "o"),
        (position, 1e3, "across the line of sight", ORANGE, "s"),
        (heading, np.degrees(1), "heading", GREEN, "^"),
    )):  # fmt: skip
        error, bound = (factor * np.array([rms(v[rows, column]) for rows in bins]) for v in (seen.error, seen.bound))
        axis.plot(angle, error, marker, color=colour, ms=5, label=f"{name}: error")
        axis.plot(angle[angle > least], bound[angle > least], color=colour, lw=1.4, label=f"{name}: bound")
    for axis, name, unit in ((position, "position", "mm"), (heading, "heading", "°")):
        axis.set(xlabel="angle between plate and line of sight [°]", xlim=(0, 90), xticks=range(0, 91, 15))
        axis.set(ylabel=f"error of {name}, rms [{unit}]", title=name.capitalize(), yscale="log")
        log_ticks(axis.yaxis)
        mark_span(axis, 0, least)
    legend_below(figure, [handle for axis in (position, heading) for handle in axis.get_legend_handles_labels()[0]])
    return figure
