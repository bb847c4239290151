"""Figures of the slip laws fitted to steady runs: all of them through the samples, and what each leaves over."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.measuring.inner_outer import ROLES, RoleSamples
from experiments.measuring.value_groups import repeated
from experiments.report.figures.axes import curve_radii, show_radii
from experiments.report.figures.error_bars import bar_factor, bar_key, draw_bars, with_bars
from experiments.report.figures.style import BAND, INNER, LABELS, OUTER, law_line, limits_around, styled
from trackslip.identification.comparison import Comparison
from trackslip.kinematics import Array
from trackslip.slip.base import SlipLaw
from trackslip.slip.exponential import PUBLISHED

_POLE = 0.5  # beyond it a law is near its pole [-]
_STRONG = ("published", "exponential", "icr_radius")
_COLUMNS = 3
_RUN = "#444444"
_ROLE_STYLE: dict[str, dict[str, Any]] = {
    "outer": {"color": OUTER, "marker": "o", "ms": 3.6},
    "inner": {"color": INNER, "marker": "s", "ms": 3.6, "mfc": "none"},
}


def shown_laws(comparison: Comparison) -> dict[str, SlipLaw]:
    """The fitted laws, those with the smallest AICc first, and the published one."""
    return {name: comparison.laws[name].law for name in comparison.ranking} | {"published": PUBLISHED}


@styled
def fitted_laws(runs: RoleSamples, comparison: Comparison) -> Figure:
    """Fig. 6: slip against observed radius with every law, the best, the paper's and icr_radius drawn strongest."""
    figure = Figure(figsize=(9.0, 5.4), layout="constrained")
    axes = figure.subplots(1, 2)
    laws = shown_laws(comparison)
    radius = curve_radii(runs)
    factor = bar_factor(runs)
    strong = {*_STRONG, comparison.best}
    for axis, name in zip(axes, reversed(ROLES), strict=True):
        role = ROLES.index(name)
        slip = runs.slip[:, role]
        near = [(runs.slip - runs.residual(law))[:, role] for key, law in laws.items() if key in strong]
        known = [value[np.abs(value) < _POLE] for value in near]  # the laws at the runs' radii
        limits = limits_around(np.concatenate([with_bars(runs, role, factor), *known]))
        for key, law in laws.items():
            for curve in runs.curves(law, radius):
                _line(axis, radius, curve[:, role], limits, key, strong=key in strong)
        axis.plot(runs.radius, slip, "o", color=_RUN, ms=4, mew=0, zorder=6)
        if runs.errors is not None:
            draw_bars(axis, runs.radius, slip, factor * runs.errors.radius, factor * runs.errors.slip[:, role])
        axis.set(title=f"{name.capitalize()} track", ylim=limits)
        show_radii(axis, runs)
    axes[0].set_ylabel("slip i [–]")
    handles = [
        Line2D([], [], color=_RUN, marker="o", ms=4, ls="none", label="runs"),
        *bar_key(factor),
        *(Line2D([], [], **_style(key, comparison.best, strong=key in strong)) for key in laws),
    ]
    figure.legend(handles=handles, ncols=4, loc="outside lower center", handlelength=3.2)
    return figure


def _line(axis: Axes, radius: Array, slip: Array, limits: tuple[float, float], key: str, *, strong: bool) -> None:
    """A law's curve, interrupted where it is far outside, near its pole."""
    low, high = limits
    inside = np.where((slip > 2 * low - high) & (slip < 2 * high - low), slip, np.nan)
    axis.plot(radius, inside, **_style(key, "", strong=strong))


def _style(key: str, best: str, *, strong: bool) -> dict[str, Any]:
    label = LABELS.get(key, key) + (" – best" if key == best else "")
    return law_line(key, label=label, lw=2.0 if strong else 1.0)


@styled
def residuals(runs: RoleSamples, comparison: Comparison) -> Figure:
    """What each law leaves over of every run, a panel each on a common scale, linear within the band of errors."""
    laws = shown_laws(comparison)
    rows = -(-len(laws) // _COLUMNS)
    figure = Figure(figsize=(9.0, 0.7 + 1.75 * rows), layout="constrained")
    axes = figure.subplots(rows, _COLUMNS, sharex=True, sharey=True, squeeze=False).ravel()
    band, meaning = residual_band(runs, comparison)
    largest = max(float(np.abs(runs.residual(law)).max()) for law in laws.values())
    threshold = 10.0 ** np.floor(np.log10(max(band, 1e-4 * largest, 1e-9)))
    for axis, (key, law) in zip(axes, laws.items(), strict=False):
        _residual_panel(axis, runs, runs.residual(law))
        axis.axhspan(-band, band, color=BAND, lw=0, zorder=0)
        best = " – best" if key == comparison.best else ""
        axis.set_title(f"{LABELS.get(key, key)}{best}", fontsize=8.5)
    axes[0].set_yscale("symlog", linthresh=threshold, linscale=0.6)
    axes[0].set_ylim(-2 * largest, 2 * largest)
    axes[0].set_yticks(_ticks(threshold, largest))
    for axis in axes[len(laws) :]:
        axis.set_visible(False)
    for column in range(_COLUMNS):
        lowest = axes[: len(laws)][column::_COLUMNS]
        if len(lowest):
            show_radii(lowest[-1], runs)
            lowest[-1].tick_params(labelbottom=True)
    for axis in axes[::_COLUMNS]:
        axis.set_ylabel("measured − law [–]")
    handles = [
        *(Line2D([], [], ls="none", label=f"{name} track", **_ROLE_STYLE[name]) for name in reversed(ROLES)),
        Line2D([], [], color=BAND, lw=7, label=f"±{band:.1g}: {meaning}"),
    ]
    figure.legend(handles=handles, ncols=3, loc="outside lower center")
    return figure


def _residual_panel(axis: Axes, runs: RoleSamples, residual: Array) -> None:
    """Every run's residual with its error, and the means of repeated radii joined by a line."""
    axis.axhline(0, color="#888888", lw=0.8)
    for role, name in enumerate(ROLES):
        style = _ROLE_STYLE[name]
        errors = None if runs.errors is None else runs.errors.slip[:, role]
        axis.errorbar(runs.radius, residual[:, role], yerr=errors, ls="none", elinewidth=0.8, mew=0.8, **style)
        means = [(runs.radius[group].mean(), residual[group, role].mean()) for group in repeated(runs.radius)]
        if means:
            axis.plot(*np.transpose(means), color=style["color"], lw=0.8)


def residual_band(runs: RoleSamples, comparison: Comparison) -> tuple[float, str]:
    """Half width of the residuals that need no other law to explain them [-], and what it is."""
    if runs.errors is not None:
        return 2 * float(np.median(runs.errors.slip)), "two standard errors of measurement"
    return 2 * max(comparison.laws[comparison.best].scatter, 1e-9), "twice the scatter about the best law"


def _ticks(threshold: float, largest: float) -> list[float]:
    """Zero, and of both signs the powers of ten above the threshold, where the scale is logarithmic."""
    powers = threshold * 10.0 ** np.arange(1, max(1.0, np.log10(1.5 * largest / threshold)) + 1e-9)
    return [*(-powers[::-1]), 0.0, *powers]
