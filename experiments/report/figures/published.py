"""The paper's result and the simulation's at a glance: the radii driven, and the slip behind them."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.measuring.grid import RadiusSummary
from experiments.measuring.inner_outer import TRACKS, InnerOuterSamples, slip_at
from experiments.report.colours import BLACK, GREY
from experiments.report.figures.axes import curve_radii, show_radii
from experiments.report.figures.style import INNER, OUTER, limits_around, styled
from trackslip.paper import COMMANDED_RADII, OBSERVED_RADII
from trackslip.slip.exponential import PUBLISHED

_PAPER: dict[str, Any] = {"color": BLACK, "marker": "x", "ms": 7, "mew": 1.6}


@styled
def published_and_simulated(radius: RadiusSummary, runs: InnerOuterSamples) -> Figure:
    """Radius driven against radius commanded, and slip against radius, published and simulated."""
    figure = Figure(figsize=(9.0, 3.7), layout="constrained")
    driven, slips = figure.subplots(1, 2, width_ratios=(1, 1.35))
    most = 1.08 * max(*radius.commanded, *COMMANDED_RADII)
    driven.plot([0, most], [0, most], color=GREY, lw=1.0, label="without slip")
    driven.plot(COMMANDED_RADII, OBSERVED_RADII, ls="none", label="published", **_PAPER)
    driven.plot(radius.commanded, radius.observed, "o", color=OUTER, ms=6, label="simulated")
    driven.set(xlabel="radius commanded [m]", ylabel="radius driven [m]", title="Wider than commanded")
    driven.set(xlim=(0, None), ylim=(0, None))
    driven.legend(loc="upper left")
    curve = curve_radii(runs)
    published = slip_at(PUBLISHED, np.array(OBSERVED_RADII), 1.0)
    for track, (name, colour, marker) in enumerate(zip(TRACKS, (INNER, OUTER), "so", strict=True)):
        slips.plot(curve, slip_at(PUBLISHED, curve, 1.0)[:, track], color=BLACK, ls="--", lw=1.3)
        slips.plot(OBSERVED_RADII, published[:, track], ls="none", **_PAPER)
        slips.plot(
            runs.radius, runs.slip[:, track], marker, color=colour, ms=6, mfc="none", label=f"{name} track, simulated"
        )
    slips.plot([], [], ls="--", lw=1.3, label="Eq. 11, published", **_PAPER)
    slips.axhline(0, color=GREY, lw=0.8, zorder=1)
    slips.set(ylabel="slip i [–]", title="Because the tracks slip", ylim=limits_around(np.append(runs.slip, published)))
    show_radii(slips, runs)
    slips.legend(loc="lower right")
    return figure
