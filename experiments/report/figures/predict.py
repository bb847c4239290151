"""The figure of a prediction: offset and slip against the radius, for several moduli of shear."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from experiments.report.colours import BLACK
from experiments.report.figures.style import RADII_SHADES, log_ticks, shade, styled, subplots
from trackslip.errors import InvalidValueError
from trackslip.skid_theory import Contact, Load, Turns, steady_turns

MODULI = (0.0, 0.002, 0.005, 0.01, 0.025)
"""Shear moduli that every figure shows [m]."""
_RADII = 30
_WIDEST = 3.5  # radius to which the lines go, at least [m]


@styled
def draw_prediction(turns: Turns, contact: Contact, shear: float, load: Load) -> Figure:
    """Draw the turns on ground with modulus `shear` [m], and the same on other ground."""
    figure, (offset, slip) = subplots(3.8, 1, 2)
    radius = np.geomspace(min(turns.radius.min(), 2 * turns.half_gauge), max(_WIDEST, turns.radius.max()), _RADII)
    moduli = sorted({*MODULI, shear})
    for k, modulus in enumerate(moduli):
        try:
            line = steady_turns(radius, contact, modulus, load)
        except InvalidValueError:  # softer ground than asked for may not carry the load in every turn
            continue
        look = {"color": shade(RADII_SHADES, k / (len(moduli) - 1)), "lw": 2.4 if modulus == shear else 1.3}
        offset.plot(radius, 1e3 * line.offset, label=f"K = {1e3 * modulus:g} mm", **look)
        slip.plot(radius, line.slip[:, 1], **look)
        slip.plot(radius, line.slip[:, 0], ls="--", **look)
    offset.plot(turns.radius, 1e3 * turns.offset, "o", color=BLACK, ms=4)
    for side in (1, 0):
        slip.plot(turns.radius, turns.slip[:, side], "o", color=BLACK, ms=4)
    offset.set(title="Offset of the tracks' ICRs", xlabel="radius driven [m]", ylabel="D [mm]", xscale="log")
    slip.set(title="Slip: outer track, inner dashed", xlabel="radius driven [m]", ylabel="slip [–]", xscale="log")
    slip.set_ylim(-0.4, 0.4)
    for axes in (offset, slip):
        log_ticks(axes.xaxis)
    offset.legend(loc="best")
    return figure
