"""Panels: parts of a figure that are drawn separately, so that they stack on a narrow page."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.report.colours import BLACK, BLUE, RED

RECIPE: dict[str, Any] = {"color": BLUE, "marker": "o"}
"""Look of the model's contacts in every figure."""
DEFAULT: dict[str, Any] = {"color": RED, "marker": "^"}
"""Look of MuJoCo's default contact."""
THEORY: dict[str, Any] = {"color": BLACK, "lw": 1.0}

Panels = tuple[Figure, ...]


def panel(title: str, xlabel: str, ylabel: str) -> tuple[Figure, Axes]:
    """A figure with one set of axes, about as wide as a phone."""
    figure = Figure(figsize=(4.6, 3.6), layout="constrained")
    axes = figure.subplots()
    axes.set(title=title, xlabel=xlabel, ylabel=ylabel)
    return figure, axes
