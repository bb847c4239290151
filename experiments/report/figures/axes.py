"""The axis of observed radii: linear from zero, or logarithmic where the radii differ much."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from experiments.measuring.inner_outer import RoleSamples
from trackslip.kinematics import Array

_WIDE = 8.0  # ratio of the largest to the smallest radius from which the axis is logarithmic
_MIN_RADIUS = 1e-3  # radius at which curves begin [m]
_MIN_SPAN = 0.5  # radius up to which the axis reaches at least [m]


def is_wide(runs: RoleSamples) -> bool:
    """Whether the radii take a logarithmic axis; turns on the spot, of radius zero, have no place on one."""
    return bool(0 < float(runs.radius.min()) < float(runs.radius.max()) / _WIDE)


def curve_radii(runs: RoleSamples) -> Array:
    """(m,) radii for the curves of laws, a little beyond the runs' [m]."""
    least = max(0.85 * float(runs.radius.min()), _MIN_RADIUS)
    most = max(1.08 * float(runs.radius.max()), _MIN_SPAN)
    return np.geomspace(least, most, 300) if is_wide(runs) else np.linspace(least, most, 300)


def show_radii(axis: Axes, runs: RoleSamples) -> None:
    """Scale, limits, ticks and label."""
    axis.set_xlabel("observed radius R [m]")
    radius = curve_radii(runs)
    if is_wide(runs):
        axis.set_xscale("log")
        axis.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.set_xlim(radius[0], radius[-1])
    else:
        on_the_spot = float(runs.radius.min()) < _MIN_RADIUS
        axis.set_xlim(-0.04 * radius[-1] if on_the_spot else 0.0, radius[-1])
