"""Figures on a robot and its ground: slip in turns, and acceleration on slopes."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from experiments.common.colours import BLUE, ORANGE
from experiments.common.style import SPEED_SHADES, THEORY, Panels, panel, shade, styled, zero_line
from experiments.validate.measurements import Turns
from trackslip.kinematics import Array


@styled
def panels(turns: Turns, radius: Array, speed: Array, sliding: Mapping[str, Array]) -> Panels:
    """Slip of both tracks against commanded radius, and acceleration down slopes that don't hold
    the robot.
    """
    slips, axes = panel("Slip of the outer and the inner track", "radius commanded [m]", "slip [–]")
    for k, value in enumerate(np.unique(speed)):
        chosen = np.flatnonzero(speed == value)
        axes.plot(radius[chosen], turns.slip[0, chosen], **THEORY, zorder=1)
        look: dict[str, Any] = {
            "marker": "os^Dv"[k],
            "ls": "none",
            "color": shade(SPEED_SHADES, k / 4),
            "ms": 9.0 - 1.1 * k,
            "mfc": "none",
        }
        labels = [f"{value:.3g} m/s", None]  # of both tracks
        axes.plot(radius[chosen], turns.slip[1, chosen], label=labels, **look)
    zero_line(axes)
    axes.legend(loc="lower right", ncols=2)
    if not sliding:
        return (slips,)
    slopes, axes = panel("Sliding down slopes", "slope [°]", "acceleration [m/s²]")
    for direction, colour in zip(sliding, (BLUE, ORANGE), strict=False):
        slope, expected, simulated = sliding[direction]
        degrees = np.degrees(slope)
        axes.plot(degrees, expected, color=colour, lw=1.2)
        axes.plot(degrees, simulated, "o", color=colour, mfc="none", label=direction)
    axes.legend(loc="upper left")
    return slips, slopes
