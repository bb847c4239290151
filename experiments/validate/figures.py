"""Figures on a robot and its ground: simulated minus theory, with the bounds."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from experiments.common.check import Check
from experiments.common.colours import BLUE, ORANGE, RED
from experiments.common.style import (
    BAND,
    SPEED_SHADES,
    Panels,
    key,
    legend_below,
    panel,
    shade,
    styled,
    zero_line,
)
from experiments.validate.checks import SLIDING_BOUND, SLIP_BOUND
from experiments.validate.measurements import Turns
from trackslip.kinematics import Array

_NAME: Final = 24  # characters in a line of a check's name


@styled
def checks_figure(checks: Sequence[Check]) -> Figure:
    """Simulated minus theory of each check, as a share of its bound."""
    title = "Simulated minus theory"
    figure, axes = panel(title, "share of the bound [–]", "", 1.0 + 0.36 * len(checks))
    shares = np.array([_share_of_bound(check) for check in checks])
    known = np.abs(shares[np.isfinite(shares)])
    most = 1.1 * max(1.0, float(known.max(initial=0.0)))
    axes.axvspan(-1, 1, color=BAND, lw=0)
    axes.axvline(0, color="#888888", lw=0.8)
    for row, (share, check) in enumerate(zip(shares, checks, strict=True)):
        colour = BLUE if check.holds else RED
        axes.plot([0, share], [row, row], color=colour, lw=1.5)
        axes.plot(share, row, "o", color=colour, ms=5)
    names = [check.what if check.holds else f"{check.what}: failed" for check in checks]
    axes.set_yticks(range(len(checks)), [textwrap.fill(name, _NAME) for name in names])
    axes.set_ylim(len(checks) - 0.5, -0.5)
    axes.set_xlim(-most, most)
    return figure


def _share_of_bound(check: Check) -> float:
    """The deviation of a check as a share of its bound [-]."""
    _, high = check.ends
    return (check.measured - check.expected) / (high - check.expected)


@styled
def deviations(turns: Turns, radius: Array, speed: Array, sliding: Mapping[str, Array]) -> Panels:
    """Slip of both tracks minus theory over the commanded radius, and acceleration minus theory on
    slopes that don't hold the robot, each with its bound.
    """
    figures = []
    theory, simulated = turns.slip
    for track, name in ((0, "inner"), (1, "outer")):
        figure, axes = panel(
            f"Slip of the {name} track", "radius commanded [m]", "simulated minus theory [–]"
        )
        ends = [radius.min(), radius.max()]
        axes.fill_between(ends, -SLIP_BOUND, SLIP_BOUND, color=BAND, lw=0, label="bound")
        for k, value in enumerate(np.unique(speed)):
            chosen = np.flatnonzero(speed == value)
            look: dict[str, Any] = {
                "marker": "os^Dv"[k],
                "color": shade(SPEED_SHADES, k / 4),
                "ms": 5.0,
                "mfc": "none",
                "lw": 0.8,
            }
            error = simulated[chosen, track] - theory[chosen, track]
            axes.plot(radius[chosen], error, label=f"{value:.3g} m/s", **look)
        zero_line(axes)
        legend_below(figure, axes.get_legend_handles_labels()[0])
        figures.append(figure)
    if sliding:
        figures.append(_sliding_figure(sliding))
    return tuple(figures)


def _sliding_figure(sliding: Mapping[str, Array]) -> Figure:
    """Acceleration minus Coulomb's law on slopes."""
    figure, axes = panel("Sliding down slopes", "slope [°]", "simulated minus theory [m/s²]")
    keys = [key("bound", color=BAND, lw=6)]
    for direction, colour in zip(sliding, (BLUE, ORANGE), strict=False):
        slope, expected, simulated = sliding[direction]
        degrees = np.degrees(slope)
        bound = SLIDING_BOUND * expected
        axes.fill_between(degrees, -bound, bound, color=BAND, lw=0)
        axes.plot(degrees, simulated - expected, "o-", color=colour, mfc="none", lw=0.8)
        keys.append(key(direction, color=colour, marker="o", mfc="none", lw=0.8))
    zero_line(axes)
    legend_below(figure, keys)
    return figure
