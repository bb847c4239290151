"""The paper's result and the simulation's at a glance: the radii that were driven, and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.measuring.inner_outer import ROLES, RoleSamples, slip_at
from experiments.report.figures.axes import curve_radii, show_radii
from experiments.report.figures.style import BLACK, GREY, INNER, OUTER, limits_around, styled
from trackslip.paper import COMMANDED_RADII, OBSERVED_RADII
from trackslip.slip.exponential import PUBLISHED

_PAPER: dict[str, Any] = {"color": BLACK, "marker": "x", "ms": 7, "mew": 1.6}


@styled
def published_and_simulated(radius: Mapping[str, Sequence[float | None]], runs: RoleSamples) -> Figure:
    """Radius driven against radius commanded, and slip against radius, each published and simulated.

    `radius` has `commanded` and `observed` radii of the simulation [m], None where none was observed.
    """
    figure = Figure(figsize=(9.0, 3.7), layout="constrained")
    driven, slips = figure.subplots(1, 2, width_ratios=(1, 1.35))
    commanded, observed = (np.array(radius[key], float) for key in ("commanded", "observed"))
    most = 1.08 * max(np.nanmax(commanded), *COMMANDED_RADII)
    driven.plot([0, most], [0, most], color=GREY, lw=1.0, label="without slip")
    driven.plot(COMMANDED_RADII, OBSERVED_RADII, ls="none", label="published", **_PAPER)
    driven.plot(commanded, observed, "o", color=OUTER, ms=6, label="simulated")
    driven.set(xlabel="radius commanded [m]", ylabel="radius driven [m]", title="Wider than asked for")
    driven.set(xlim=(0, None), ylim=(0, None))
    driven.legend(loc="upper left")
    curve = curve_radii(runs)
    published = slip_at(PUBLISHED, np.array(OBSERVED_RADII), 1.0)
    for role, (name, colour, marker) in enumerate(zip(ROLES, (INNER, OUTER), "so", strict=True)):
        slips.plot(curve, slip_at(PUBLISHED, curve, 1.0)[:, role], color=BLACK, ls="--", lw=1.3)
        slips.plot(OBSERVED_RADII, published[:, role], ls="none", **_PAPER)
        slips.plot(
            runs.radius, runs.slip[:, role], marker, color=colour, ms=6, mfc="none", label=f"{name} track, simulated"
        )
    slips.plot([], [], ls="--", lw=1.3, label="Eq. 11, published", **_PAPER)
    slips.axhline(0, color=GREY, lw=0.8, zorder=1)
    slips.set(ylabel="slip i [–]", title="Because the tracks slip", ylim=limits_around(np.append(runs.slip, published)))
    show_radii(slips, runs)
    slips.legend(loc="lower right")
    return figure
