"""How all figures look: the same colour and line for the same slip law everywhere."""

from __future__ import annotations

from typing import Any

import matplotlib

from experiments.colours import BLACK as BLACK
from experiments.colours import BLUE as BLUE
from experiments.colours import COLOURS as COLOURS
from experiments.colours import GREEN as GREEN
from experiments.colours import LABELS as LABELS
from experiments.colours import ORANGE as ORANGE
from experiments.colours import VERMILLION as VERMILLION
from trackslip.kinematics import Array

DASHES = {
    "none": "-",
    "published": "--",
    "constant": (0, (6, 2)),
    "exponential": "-.",
    "exponential_speed": (0, (6, 1.5, 1, 1.5, 1, 1.5)),
    "power": (0, (3, 1.5)),
    "hyperbola": (0, (4, 1.5, 1, 1.5)),
    "icr": (0, (1, 1)),
    "icr_radius": "-",
    "icr_sides": (0, (1, 2.5)),
    "online": (0, (5, 1)),
    "online_cold": (0, (5, 1, 1, 1)),
}
"""Line styles, so that the laws can be told apart without colour too."""
INNER, OUTER = ORANGE, BLUE
"""Colours of the tracks by their role in the turn."""
BAND = "#d5e6d5"
"""Colour behind values that say nothing, being too small."""
STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.7,
    "lines.linewidth": 1.5,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "path.simplify_threshold": 0.3,
}
POINTS = 500
"""Points of a line that the eye can still tell apart at the figures' width."""

styled = matplotlib.rc_context(STYLE)


def thin(rows: int, most: int = POINTS) -> slice:
    """Every n-th of `rows` rows, so that about `most` are left."""
    return slice(None, None, max(1, rows // most))


def limits_around(values: Array) -> tuple[float, float]:
    """Limits of an axis that shows values (n,) and zero, and leaves a law's pole outside."""
    low, high = min(0.0, float(values.min())), max(0.0, float(values.max()))
    room = 0.12 * (high - low) + 1e-4
    return low - room, high + room


def law_line(name: str, **more: object) -> dict[str, object]:
    """Keywords of a line that stands for the slip law or compensation `name`."""
    return {"color": COLOURS.get(name, GREEN), "linestyle": DASHES.get(name, "-"), **more}
