"""Figures of a validation of ground that shears."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.common.style import RADII_SHADES, Panels, make_room, panel, shade, styled
from experiments.validate.shear_loads import MODULI, Slips, StopAndGo
from trackslip.kinematics import Array

if TYPE_CHECKING:
    from experiments.validate.shear import ShearTurns

_MARKERS = "osD^"


@styled
def offsets(turns: ShearTurns, half_gauge: float) -> Figure:
    """D against the radius on ground with every modulus."""
    figure, axes = panel("Turns", "radius commanded [m]", "D [mm]")
    for k, shear in enumerate((0.0, *MODULI)):
        rows = (turns.shear == shear) & ~turns.spins
        radius = np.unique(turns.radius[rows])
        simulated, expected = (
            1e3 * (np.array([part[rows & (turns.radius == r)].mean() for r in radius]) - half_gauge)
            for part in (turns.half_width, turns.expected_half_width)
        )
        _compared(axes, radius, simulated, expected, k - 1, _name(shear))
    make_room(axes, 0.25)
    axes.legend(loc="upper center", ncols=3)
    return figure


@styled
def slips(slopes: Slips, pulls: Slips) -> Panels:
    """Slip straight ahead against slope and pull."""
    on_slopes, axes = panel("Slopes", "slope [°]", "slip [–]")
    _against_load(axes, slopes, 180 / np.pi)
    pulling, axes = panel("Drawbar pull", "pull / weight [–]", "slip [–]")
    _against_load(axes, pulls, 1.0)
    return on_slopes, pulling


@styled
def stops(found: StopAndGo) -> Figure:
    """Distance slipped on a slope with stops."""
    figure, axes = panel("Stop and go on 10°", "time [s]", "distance slipped [mm]")
    for k, shear in enumerate(MODULI):
        colour = _colour(k)
        axes.plot(found.time, 1e3 * found.expected[:, k], color=colour, lw=1.0)
        axes.plot(found.time, 1e3 * found.slipped[:, k], color=colour, ls=":", lw=2.4, label=_name(shear))
    axes.legend(loc="best")
    return figure


def _against_load(axes: Axes, found: Slips, scale: float) -> None:
    for k, shear in enumerate(MODULI):
        rows = (found.shear == shear) & ~found.turns
        slip, expected = (part[rows].mean(axis=1) for part in (found.slip, found.expected))
        _compared(axes, scale * found.load[rows], slip, expected, k, _name(shear))
    axes.legend(loc="best")


def _compared(axes: Axes, x: Array, simulated: Array, expected: Array, k: int, name: str) -> None:
    axes.plot(x, expected, color=_colour(k), lw=1.0)
    axes.plot(x, simulated, _MARKERS[k % len(_MARKERS)], color=_colour(k), ms=4.5, label=name)


def _colour(k: int) -> tuple[float, float, float, float]:
    return shade(RADII_SHADES, (k + 1) / len(MODULI))


def _name(shear: float) -> str:
    return f"K = {1e3 * shear:g} mm"
