"""How all figures look: the same colour and line for the same slip law everywhere."""

from __future__ import annotations

from typing import Any

import matplotlib

BLUE, ORANGE, GREEN, VERMILLION, BLACK = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#1a1a1a"
COLOURS = {
    "none": VERMILLION,
    "published": BLACK,
    "exponential": "#CC79A7",
    "icr": "#56B4E9",
    "icr_radius": BLUE,
}
"""The same colour for the same slip law in every figure (Okabe and Ito's palette)."""
LABELS = {
    "none": "no compensation",
    "published": "published law (Eq. 11)",
    "exponential": "exponential, fitted",
    "icr": "constant ICR, fitted",
    "icr_radius": "constant ICR with ε, fitted",
}
DASHES = {"none": "-", "published": "--", "exponential": "-.", "icr": (0, (1, 1)), "icr_radius": "-"}
"""Line styles, so that the laws can be told apart without colour too."""
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


def law_line(name: str, **more: object) -> dict[str, object]:
    """Keywords of a line that stands for the slip law or compensation `name`."""
    return {"color": COLOURS.get(name, GREEN), "linestyle": DASHES.get(name, "-"), **more}
