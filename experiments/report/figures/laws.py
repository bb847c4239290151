"""Figures of fitted slip laws: curves, residuals, criteria, and correlations of the parameters."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator

from experiments.measuring.inner_outer import TRACKS, InnerOuterSamples
from experiments.measuring.value_groups import repeated
from experiments.report.colours import COLOURS, GREEN, LABELS
from experiments.report.figures.axes import bar_factor, bar_key, curve_radii, draw_bars, show_radii, with_bars
from experiments.report.figures.style import BAND, INNER, OUTER, law_line, legend_below, limits_around, styled, subplots
from experiments.report.law_symbols import SYMBOLS
from trackslip.identification.comparison import Comparison
from trackslip.identification.fitted import FittedLaw
from trackslip.kinematics import Array
from trackslip.slip.base import SlipLaw
from trackslip.slip.exponential import PUBLISHED

_POLE = 0.5  # slip beyond which a law is near its pole [-]
_STRONG = ("published", "exponential", "icr_radius")
_COLUMNS = 3
_INDISTINCT = 2.0  # difference of AICc that decides nothing
_DECIDED = 10.0  # difference of AICc up to which the axis is linear
_POWERS = 5  # of ten, labelled at an axis that small
_DARK = 0.6  # correlation whose cell is too dark for black text
_RUN = "#444444"
_TRACK_STYLE: dict[str, dict[str, Any]] = {
    "outer": {"color": OUTER, "marker": "o", "ms": 3.6},
    "inner": {"color": INNER, "marker": "s", "ms": 3.6, "mfc": "none"},
}


def shown_laws(comparison: Comparison) -> dict[str, SlipLaw]:
    """The fitted laws, smallest AICc first, and the published one."""
    return {name: comparison.laws[name].law for name in comparison.ranking} | {"published": PUBLISHED}


@styled
def fitted_laws(runs: InnerOuterSamples, comparison: Comparison) -> Figure:
    """Fig. 6: slip against observed radius with every law; thick: the best, the paper's, and icr_radius."""
    figure, axes = subplots(4.6, 1, 2)
    laws = shown_laws(comparison)
    radius = curve_radii(runs)
    factor = bar_factor(runs)
    strong = {*_STRONG, comparison.best}
    looks = {key: law_line(key, label=_title(key, comparison), lw=2.0 if key in strong else 1.0) for key in laws}
    for axis, name in zip(axes, reversed(TRACKS), strict=True):
        track = TRACKS.index(name)
        slip = runs.slip[:, track]
        near = [(runs.slip - runs.residual(law))[:, track] for key, law in laws.items() if key in strong]
        known = [value[np.abs(value) < _POLE] for value in near]  # the laws at the runs' radii
        low, high = limits_around(np.concatenate([with_bars(runs, track, factor), *known]))
        for key, law in laws.items():
            for curve in runs.curves(law, radius):
                beyond = (curve <= 2 * low - high) | (curve >= 2 * high - low)  # far outside the axes, near a pole
                axis.plot(radius, np.where(beyond, np.nan, curve)[:, track], **looks[key])
        axis.plot(runs.radius, slip, "o", color=_RUN, ms=4, mew=0, zorder=6)
        if runs.errors is not None:
            draw_bars(axis, runs.radius, slip, factor * runs.errors.radius, factor * runs.errors.slip[:, track])
        axis.set(title=f"{name.capitalize()} track", ylim=(low, high))
        show_radii(axis, runs)
    axes[0].set_ylabel("slip i [–]")
    handles = [
        Line2D([], [], color=_RUN, marker="o", ms=4, ls="none", label="runs"),
        *bar_key(factor),
        *(Line2D([], [], **look) for look in looks.values()),
    ]
    legend_below(figure, handles, ncols=4, handlelength=3.2)
    return figure


def _title(name: str, comparison: Comparison) -> str:
    return LABELS.get(name, name) + (" – best" if name == comparison.best else "")


@styled
def residuals(runs: InnerOuterSamples, comparison: Comparison) -> Figure:
    """Residuals of every run, one panel per law on a common scale that is linear within the band of errors."""
    laws = shown_laws(comparison)
    rows = -(-len(laws) // _COLUMNS)
    figure, axes = subplots(
        0.6 + 1.75 * rows, rows, _COLUMNS, across=0.3, down=0.35, sharex=True, sharey=True, squeeze=False
    )
    axes = axes.ravel()
    band, meaning = residual_band(runs, comparison)
    largest = max(float(np.abs(runs.residual(law)).max()) for law in laws.values())
    threshold = 10.0 ** np.floor(np.log10(max(band, 1e-4 * largest, 1e-9)))
    # Limits come first: each line would have those of all panels found again.
    axes[0].set_yscale("symlog", linthresh=threshold, linscale=0.6)
    axes[0].set_ylim(-2 * largest, 2 * largest)
    axes[0].set_yticks(_ticks(threshold, largest))
    for axis in axes[len(laws) :]:
        axis.remove()
    for axis in axes[: len(laws)][-_COLUMNS:]:  # the lowest of each column
        show_radii(axis, runs)
        axis.tick_params(labelbottom=True)
    for axis, (key, law) in zip(axes, laws.items(), strict=False):
        _residual_panel(axis, runs, runs.residual(law))
        axis.axhspan(-band, band, color=BAND, lw=0, zorder=0)
        axis.set_title(_title(key, comparison), fontsize=8.5)
    for axis in axes[::_COLUMNS]:
        axis.set_ylabel("measured − law [–]")
    handles = [
        *(Line2D([], [], ls="none", label=f"{name} track", **_TRACK_STYLE[name]) for name in reversed(TRACKS)),
        Line2D([], [], color=BAND, lw=7, label=f"±{band:.1g}: {meaning}"),
    ]
    legend_below(figure, handles)
    return figure


def _residual_panel(axis: Axes, runs: InnerOuterSamples, residual: Array) -> None:
    """Draw the residual of every run with its error, and a line through the means of repeated radii."""
    axis.axhline(0, color="#888888", lw=0.8)
    for track, name in enumerate(TRACKS):
        style = _TRACK_STYLE[name]
        colour, off = style["color"], residual[:, track]
        if runs.errors is not None:
            draw_bars(axis, runs.radius, off, None, runs.errors.slip[:, track], color=colour, lw=0.8, zorder=2)
        axis.plot(runs.radius, off, ls="none", mew=0.8, zorder=2.1, **style)
        means = [(runs.radius[group].mean(), residual[group, track].mean()) for group in repeated(runs.radius)]
        if means:
            axis.plot(*np.transpose(means), color=colour, lw=0.8)


def residual_band(runs: InnerOuterSamples, comparison: Comparison) -> tuple[float, str]:
    """Half width of the residuals that need no better law to explain them [-], and its meaning."""
    if runs.errors is not None:
        return 2 * float(np.median(runs.errors.slip)), "two standard errors of measurement"
    return 2 * max(comparison.laws[comparison.best].scatter, 1e-9), "twice the scatter about the best law"


def _ticks(threshold: float, largest: float) -> list[float]:
    """Zero, and the powers of ten of both signs above the threshold, where the scale is logarithmic."""
    powers = threshold * 10.0 ** np.arange(1, max(1.0, np.log10(1.5 * largest / threshold)) + 1e-9)
    return [*(-powers[::-1]), 0.0, *powers]


@styled
def criteria(comparison: Comparison) -> Figure:
    """AICc above the smallest, and errors of predicting left-out radii and speeds; one row per law, the best on top."""
    names = comparison.ranking
    figure, axes = subplots(1.1 + 0.27 * len(names), 1, 4, left=2.3, across=0.3, sharey=True)
    aicc = np.array([comparison.aicc[name] for name in names], float)  # NaN where it is not known
    errors = [comparison.validation[name] for name in names]
    radius, speed, yaw_rate = np.array([(e.radius, e.speed, e.yaw_rate) for e in errors], float).T
    fitted = np.array([comparison.laws[name].rms for name in names])
    for axis, title, label, values, hollow in (
        (axes[0], "Criterion", "AICc − smallest [–]", aicc - np.nanmin(aicc, initial=np.inf), None),
        (axes[1], "Radius left out", "track speeds, rms [–]", radius, fitted),
        (axes[2], "Speed left out", "track speeds, rms [–]", speed, fitted),
        (axes[3], "Radius left out", "yaw rate, rms [mrad/s]", 1e3 * yaw_rate, None),
    ):
        _dots(axis, names, values, hollow)
        axis.set(title=title, xlabel=label)
        if axis is axes[0]:
            axis.axvspan(0, _INDISTINCT, color=BAND, lw=0, zorder=0)
            axis.set_xscale("symlog", linthresh=_DECIDED)
            axis.set_xlim(-0.8, None)
        elif (values > 0).any():
            axis.set_xscale("log")
            axis.xaxis.set_major_locator(LogLocator(numticks=_POWERS))
            axis.margins(x=0.12)
    axes[0].set_yticks(range(len(names)), [LABELS.get(name, name) for name in names])
    axes[0].set_ylim(len(names) - 0.4, -0.6)
    axes[0].get_yticklabels()[names.index(comparison.best)].set_fontweight("bold")
    handles = [
        Line2D([], [], marker="o", ls="none", color="#555555", label="of runs left out of the fit"),
        Line2D([], [], marker="o", ls="none", mfc="none", color="#555555", label="of the runs fitted"),
        Line2D([], [], color=BAND, lw=7, label="indistinguishable from the best"),
    ]
    legend_below(figure, handles)
    return figure


def _dots(axis: Axes, names: Sequence[str], values: Array, hollow: Array | None) -> None:
    """Draw one dot per law at its value, and a hollow one at a second value; a note where there is none."""
    for row, (name, value) in enumerate(zip(names, values, strict=True)):
        colour = COLOURS.get(name, GREEN)
        if np.isnan(value):
            beside = axis.get_yaxis_transform()
            axis.text(0.5, row, "not known", transform=beside, va="center", ha="center", fontsize=7.5, color="#666666")
            continue
        axis.plot(value, row, "o", color=colour, ms=6)
        if hollow is not None:
            axis.plot(hollow[row], row, "o", color=colour, ms=8.5, mfc="none")


def correlated_laws(comparison: Comparison) -> list[FittedLaw]:
    """The best law and the paper's, if they have several parameters."""
    names = dict.fromkeys([comparison.best, "exponential", "icr_radius"])
    known = [comparison.laws[name] for name in names if name in comparison.laws]
    return [law for law in known if len(law.values) > 1][:2]


@styled
def correlations(laws: list[FittedLaw]) -> Figure:
    """Correlation matrices of the parameters of up to two laws."""
    figure, axes = subplots(3.7, 1, 2)
    for axis, law in zip(axes, laws, strict=False):
        draw_matrix(axis, law.correlation, [SYMBOLS.get(key, key) for key in law.values])
        axis.set_title(f"Correlations [–], {LABELS.get(law.name, law.name)}")
    for axis in axes[len(laws) :]:
        axis.set_visible(False)
    return figure


def draw_matrix(axis: Axes, correlation: Array, names: Sequence[str]) -> None:
    """Draw a cell for each pair of parameters (f, f), red for positive correlation, blue for negative."""
    # polygons, because a bitmap would blur on the page
    axis.pcolormesh(correlation, cmap="RdBu_r", vmin=-1, vmax=1, edgecolors="white", linewidth=1.5)
    places = np.arange(len(names)) + 0.5
    axis.set_xticks(places, names)
    axis.set_yticks(places, names)
    axis.tick_params(length=0)
    axis.invert_yaxis()
    axis.set_aspect("equal")
    axis.grid(visible=False)
    axis.spines[:].set_visible(False)
    for (row, column), value in np.ndenumerate(correlation):
        text = "1" if row == column else f"{value:+.2f}".replace("-", "−")
        colour = "white" if abs(value) > _DARK else "black"
        axis.text(column + 0.5, row + 0.5, text, ha="center", va="center", color=colour)
