"""Error bars of steady runs: where they are smaller than a symbol they are drawn larger, by a factor that is said."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from experiments.measuring.inner_outer import RoleSamples
from trackslip.kinematics import Array

_COLOUR = "#777777"
_MIN_SEEN = 0.03  # of the range of slips: shorter error bars are enlarged


def bar_factor(runs: RoleSamples) -> int:
    """Factor 1, 2, 5, 10, 20, ... that makes the error bars visible; 0 where the errors aren't known."""
    if runs.errors is None:
        return 0
    typical = float(np.median(runs.errors.slip))
    needed = _MIN_SEEN * float(np.ptp(runs.slip, axis=0).max()) / max(typical, 1e-300)
    factors = [step * 10**power for power in range(6) for step in (1, 2, 5)]
    return next((factor for factor in factors if factor >= needed), factors[-1])


def with_bars(runs: RoleSamples, role: int, factor: int) -> Array:
    """Slips of a role and the ends of their bars, to choose an axis' limits by: (n,) or (2 n,)."""
    slip = runs.slip[:, role]
    if runs.errors is None:
        return slip
    bar = factor * runs.errors.slip[:, role]
    return np.concatenate([slip - bar, slip + bar])


def draw_bars(axis: Axes, x: Array, y: Array, x_error: Array, y_error: Array) -> None:
    """Bars of errors (n,) each way about points (n,)."""
    axis.errorbar(x, y, xerr=x_error, yerr=y_error, fmt="none", ecolor=_COLOUR, elinewidth=0.7, zorder=4)


def bar_key(factor: int) -> list[Line2D]:
    """The entry of a legend that says what the bars are; none without errors."""
    enlarged = f" × {factor}" if factor > 1 else ""
    line = Line2D([], [], marker="+", ms=8, ls="none", color=_COLOUR, label=f"bars: standard error{enlarged}")
    return [line] if factor else []
