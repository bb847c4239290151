"""What figures of steady runs share: the axis of observed radii, and error bars."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from experiments.measuring.inner_outer import InnerOuterSamples
from trackslip.kinematics import Array

BARS: dict[str, Any] = {"color": "#777777", "lw": 0.7, "solid_capstyle": "butt", "zorder": 4}
_WIDE = 8.0  # ratio of the largest to the smallest radius above which the axis is logarithmic
_MIN_RADIUS = 1e-3  # radius at which curves begin [m]
_MIN_SPAN = 0.5  # smallest upper end of the axis [m]
_MIN_SEEN = 0.03  # share of the range of slips: shorter error bars are drawn enlarged


def is_wide(runs: InnerOuterSamples) -> bool:
    """Whether the radii need a logarithmic axis, which excludes turns on the spot, of radius zero."""
    return bool(0 < float(runs.radius.min()) < float(runs.radius.max()) / _WIDE)


def curve_radii(runs: InnerOuterSamples) -> Array:
    """Radii (m,) [m] for the curves of laws, reaching a little beyond the runs."""
    least = max(0.85 * float(runs.radius.min()), _MIN_RADIUS)
    most = max(1.08 * float(runs.radius.max()), _MIN_SPAN)
    return np.geomspace(least, most, 300) if is_wide(runs) else np.linspace(least, most, 300)


def show_radii(axis: Axes, runs: InnerOuterSamples) -> None:
    """Set scale, limits, ticks and label: linear from zero, or logarithmic where the radii differ much."""
    radius = curve_radii(runs)
    axis.set_xlabel("observed radius R [m]")
    if is_wide(runs):
        axis.set(xscale="log", xlim=(radius[0], radius[-1]))
        axis.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.xaxis.set_major_formatter("{x:g}")
        axis.xaxis.set_minor_formatter(NullFormatter())
    else:
        on_the_spot = float(runs.radius.min()) < _MIN_RADIUS
        axis.set_xlim(-0.04 * radius[-1] if on_the_spot else 0.0, radius[-1])


def bar_factor(runs: InnerOuterSamples) -> int:
    """Factor 1, 2, 5, 10, 20, ... that makes the error bars visible; 0 where the errors are not known."""
    if runs.errors is None:
        return 0
    typical = float(np.median(runs.errors.slip))
    needed = _MIN_SEEN * float(np.ptp(runs.slip, axis=0).max()) / max(typical, 1e-300)
    factors = [step * 10**power for power in range(6) for step in (1, 2, 5)]
    return next((factor for factor in factors if factor >= needed), factors[-1])


def with_bars(runs: InnerOuterSamples, track: int, factor: int) -> Array:
    """Slips of a track and the ends of their bars, (n,) or (2 n,) [-], from which the limits of an axis follow."""
    slip = runs.slip[:, track]
    if runs.errors is None:
        return slip
    bar = factor * runs.errors.slip[:, track]
    return np.concatenate([slip - bar, slip + bar])


def draw_bars(axis: Axes, x: Array, y: Array, x_error: Array | None, y_error: Array, **look: Any) -> None:
    """Draw error bars, errors (n,) to either side of the points (n,), all as one line with gaps."""
    gap = np.full_like(x, np.nan)
    upright = np.array([[x, x, gap], [y - y_error, y + y_error, gap]])
    level = [] if x_error is None else [np.array([[x - x_error, x + x_error, gap], [y, y, gap]])]
    x, y = np.concatenate([upright, *level], axis=2).swapaxes(1, 2).reshape(2, -1)
    axis.plot(x, y, **BARS | look)


def bar_key(factor: int) -> list[Line2D]:
    """The legend's entry for the error bars; empty where there are none."""
    label = "bars: standard error" + (f" × {factor}" if factor > 1 else "")
    line = Line2D([], [], marker="+", ms=8, ls="none", color=BARS["color"], label=label)
    return [line] if factor else []
