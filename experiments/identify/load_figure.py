"""Figure of slip against the traction that the robot needs."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from experiments.common.style import RADII_SHADES, shade, styled, subplots
from trackslip.identification.fitted import SteadyFit
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import SIDES, Array, RobotGeometry, body_twist
from trackslip.slip.icr_load import IcrLoad

_CURVES = 3  # of the law, from the straightest command to the tightest
_POINTS = 50  # of a curve


@styled
def slip_under_load(samples: SlipSamples, fitted: SteadyFit, geometry: RobotGeometry) -> Figure | None:
    """Slip of the speed ahead against the traction along the robot, with the law of slip under load.

    None without samples whose loads are known.
    """
    law, commanded = fitted.law, body_twist(samples.omega, 0.0, geometry)
    ahead = np.abs(commanded[:, 0]) > geometry.half_gauge * np.abs(commanded[:, 1])  # both belts run one way
    if samples.load is None or not isinstance(law, IcrLoad) or not ahead.any():
        return None
    along, commanded = samples.load[ahead, 0], commanded[ahead]
    bend = np.abs(commanded[:, 1] / commanded[:, 0])
    slip = 1 - samples.twist[ahead, 0] / commanded[:, 0]
    figure, axes = subplots(3.6)
    tightest = max(float(bend.max()), 1e-9)
    axes.scatter(along, slip, c=[shade(RADII_SHADES, k / tightest) for k in bend], s=16, zorder=3)
    load = np.linspace(min(along.min(), 0.0), max(along.max(), 0.0), _POINTS)
    for curvature in np.linspace(bend.min(), bend.max(), _CURVES):
        label = f"law, curvature commanded {curvature:.2g} 1/m"
        look = shade(RADII_SHADES, curvature / tightest)
        axes.plot(load, _slip_ahead(law, load, float(curvature), geometry), color=look, lw=1.2, label=label)
    axes.set(xlabel="traction over load, along the robot [–]", ylabel="slip of the speed ahead [–]")
    axes.legend(loc="best")
    return figure


def _slip_ahead(law: IcrLoad, load: Array, curvature: float, geometry: RobotGeometry) -> Array:
    """Slip (n,) of the speed ahead under tractions `load` (n,) along the robot, at a commanded curvature [1/m]."""
    omega = np.tile((1 + SIDES * geometry.half_gauge * curvature) / geometry.sprocket_radius, (len(load), 1))
    loaded = law.under(np.column_stack([load, np.zeros_like(load)]))
    return np.asarray(1 - loaded.twist(omega, geometry)[:, 0])
