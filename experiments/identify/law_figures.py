"""Figures of fitted slip laws: curves, residuals, criteria, and correlations of the parameters."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from experiments.common import style
from experiments.common.laws import shown, symbol
from experiments.identify.steady_figures import BARS, bar_factor, bar_key, curve_radii, show_radii, with_bars
from experiments.identify.steady_turns import TRACKS, InnerOuterSamples, repeated
from trackslip.identification.comparison import SteadyComparison
from trackslip.identification.fitted import SteadyFit
from trackslip.kinematics import Array
from trackslip.slip.base import SlipLaw
from trackslip.slip.exponential import PUBLISHED

_POLE = 0.5  # slip beyond which a law is near its pole [-]
_STRONG = ("published", "exponential", "icr_radius")
_COLUMNS = 3
_SAME = 0.01  # distance of curves that hide each other, over the height of the axes
_INDISTINCT = 2.0  # difference of AICc that decides nothing
_DECIDED = 10.0  # difference of AICc up to which the axis is linear
_DARK = 0.6  # correlation whose cell is too dark for black text
_RUN, _DOT = "#444444", "#555555"
_TRACK_STYLE: dict[str, dict[str, Any]] = {
    "outer": {"color": style.OUTER, "marker": "o", "ms": 3.6},
    "inner": {"color": style.INNER, "marker": "s", "ms": 3.6, "mfc": "none"},
}


def shown_laws(comparison: SteadyComparison) -> dict[str, SlipLaw]:
    """The fitted laws, smallest AICc first, and the published one."""
    return {name: comparison.laws[name].law for name in comparison.ranking} | {"published": PUBLISHED}


def _title(name: str, comparison: SteadyComparison) -> str:
    return shown(name).label + (" – best" if name == comparison.best else "")


@style.styled
def fitted_laws(runs: InnerOuterSamples, comparison: SteadyComparison) -> Figure:
    """Fig. 6: slip against observed radius with every law; thick: the best, the paper's, and icr_radius."""
    figure, axes = style.subplots(4.6, 1, 2)
    laws, radius, factor = shown_laws(comparison), curve_radii(runs), bar_factor(runs)
    strong = {*_STRONG, comparison.best}
    looks = {
        name: style.law_line(name, label=_title(name, comparison), lw=2.0 if name in strong else 1.0) for name in laws
    }
    for axis, side in zip(axes, reversed(TRACKS), strict=True):
        track = TRACKS.index(side)
        slip = runs.slip[:, track]
        near = [slip - runs.residual(law)[:, track] for name, law in laws.items() if name in strong]
        known = [value[np.abs(value) < _POLE] for value in near]  # the laws at the runs' radii
        low, high = style.limits_around(np.concatenate([with_bars(runs, track, factor), *known]))
        curves = {name: np.stack(runs.curves(law, radius))[..., track] for name, law in laws.items()}
        for name, hidden in hidden_by(curves, _SAME * (high - low)).items():
            for curve in curves[name]:
                beyond = (curve <= 2 * low - high) | (curve >= 2 * high - low)  # far outside the axes, near a pole
                wider = {"lw": looks[name]["lw"] + 2.5 * hidden, "alpha": 0.4} if hidden else {}
                axis.plot(radius, np.where(beyond, np.nan, curve), **looks[name] | wider)
        axis.plot(runs.radius, slip, "o", color=_RUN, ms=4, mew=0, zorder=6)
        if runs.errors is not None:
            axis.errorbar(runs.radius, slip, factor * runs.errors.slip[:, track], factor * runs.errors.radius, **BARS)
        axis.set(title=f"{side.capitalize()} track", ylim=(low, high))
        show_radii(axis, runs)
    axes[0].set_ylabel("slip i [–]")
    handles = [style.key("runs", color=_RUN, marker="o", ms=4, ls="none"), *bar_key(factor)]
    style.legend_below(figure, [*handles, *(style.key(**look) for look in looks.values())], ncols=4, handlelength=3.2)
    return figure


def hidden_by(curves: Mapping[str, Array], near: float) -> dict[str, int]:
    """By law, the number of laws drawn later whose curves all lie within `near`: so much wider is its line."""
    names = list(curves)
    return {
        name: sum(
            curves[other].shape == curves[name].shape and bool((np.abs(curves[other] - curves[name]) < near).all())
            for other in names[k + 1 :]
        )
        for k, name in enumerate(names)
    }


@style.styled
def residuals(runs: InnerOuterSamples, comparison: SteadyComparison) -> Figure:
    """Residuals of every run, one panel per law on a common scale that is linear within the band of errors."""
    band, meaning = residual_band(runs, comparison)
    off = {name: runs.residual(law) for name, law in shown_laws(comparison).items()}
    largest = max(float(np.abs(residual).max()) for residual in off.values())
    columns = _COLUMNS + (len(off) % _COLUMNS == 1 < len(off))  # no panel alone in its row
    rows = -(-len(off) // columns)
    figure, panels = style.subplots(
        0.8 + 1.75 * rows, rows, columns, across=0.3, down=0.35, sharex=True, sharey=True, squeeze=False
    )
    linear = max(band, 1e-4 * largest, 1e-9)
    panels[0, 0].set_yscale("symlog", linthresh=linear)
    panels[0, 0].set_ylim(-2 * largest, 2 * largest)
    decades = 10.0 ** np.arange(np.ceil(np.log10(linear)), np.log10(2 * largest))
    panels[0, 0].set_yticks([*-decades[::-1], 0.0, *decades])
    for axis, (name, residual) in zip(panels.flat, off.items(), strict=False):
        style.zero_line(axis)
        axis.axhspan(-band, band, color=style.BAND, lw=0, zorder=0)
        axis.set_title(_title(name, comparison), fontsize=8.5 if columns == _COLUMNS else 7.0)
        for track, side in enumerate(TRACKS):
            look = _TRACK_STYLE[side]
            if runs.errors is not None:
                bars = BARS | {"ecolor": look["color"], "zorder": 2}
                axis.errorbar(runs.radius, residual[:, track], runs.errors.slip[:, track], **bars)
            axis.plot(runs.radius, residual[:, track], ls="none", mew=0.8, zorder=2.1, **look)
            means = [(runs.radius[group].mean(), residual[group, track].mean()) for group in repeated(runs.radius)]
            axis.plot(*np.reshape(means, (-1, 2)).T, color=look["color"], lw=0.8)
    for axis in panels.flat[len(off) :]:
        axis.set_axis_off()
    for axis in panels.flat[: len(off)][-columns:]:  # the lowest of each column
        show_radii(axis, runs)
        axis.tick_params(labelbottom=True)
    for axis in panels[:, 0]:
        axis.set_ylabel("measured − law [–]")
    handles = [style.key(f"{side} track", ls="none", **_TRACK_STYLE[side]) for side in reversed(TRACKS)]
    style.legend_below(figure, [*handles, style.key(f"±{band:.1g}: {meaning}", color=style.BAND, lw=7)])
    return figure


def residual_band(runs: InnerOuterSamples, comparison: SteadyComparison) -> tuple[float, str]:
    """Half width of the residuals that need no better law to explain them [-], and its meaning."""
    if runs.errors is not None:
        return 2 * float(np.median(runs.errors.slip)), "two standard errors of measurement"
    return 2 * max(comparison.laws[comparison.best].scatter, 1e-9), "twice the scatter about the best law"


@style.styled
def criteria(comparison: SteadyComparison) -> Figure:
    """AICc above the smallest, and errors of predicting left-out radii and speeds; one row per law, the best on top."""
    names = comparison.ranking
    titles = [shown(name).label for name in names]
    figure, axes = style.subplots(
        0.95 + 0.27 * len(names), 1, 4, left=style.margin_for(titles), across=0.45, sharey=True
    )
    aicc = np.array([comparison.aicc[name] for name in names], float)  # NaN where it is not known
    errors = [comparison.validation[name] for name in names]
    radius, speed, yaw_rate = np.array([(e.radius, e.speed, e.yaw_rate) for e in errors], float).T
    fitted = np.array([comparison.laws[name].rms for name in names])
    places, colours = np.arange(len(names)), [shown(name).colour for name in names]
    for axis, title, label, values, hollow in (
        (axes[0], "Criterion", "AICc − smallest [–]", aicc - np.nanmin(aicc, initial=np.inf), None),
        (axes[1], "Radius left out", "track speeds, rms [–]", radius, fitted),
        (axes[2], "Speed left out", "track speeds, rms [–]", speed, fitted),
        (axes[3], "Radius left out", "yaw rate, rms [mrad/s]", 1e3 * yaw_rate, None),
    ):
        axis.set(title=title, xlabel=label, xscale="linear" if axis is axes[0] else "log")
        axis.scatter(values, places, c=colours, s=36)
        if hollow is not None:
            axis.scatter(np.where(np.isnan(values), np.nan, hollow), places, s=72, ec=colours, fc="none")
        for row in places[np.isnan(values)]:
            axis.text(0.5, row, "not known", transform=axis.get_yaxis_transform(), va="center", ha="center", color=_DOT)
    axes[0].axvspan(0, _INDISTINCT, color=style.BAND, lw=0, zorder=0)
    axes[0].set_xscale("symlog", linthresh=_DECIDED)
    axes[0].set_xlim(-0.8, None)
    for axis in axes[1:]:
        low, high = np.log10(axis.get_xlim())
        axis.set_xlim(10.0 ** np.floor(low), 10.0 ** np.ceil(high))  # whole decades, so that few labels suffice
        axis.xaxis.set_major_locator(LogLocator(numticks=5))
        axis.xaxis.set_minor_formatter(NullFormatter())
    axes[0].set(yticks=places, yticklabels=titles)
    axes[0].set_ylim(len(names) - 0.4, -0.6)
    axes[0].get_yticklabels()[names.index(comparison.best)].set_fontweight("bold")
    handles = [
        style.key("of runs left out of the fit", marker="o", ls="none", color=_DOT),
        style.key("of the runs fitted", marker="o", ls="none", mfc="none", color=_DOT),
        style.key("indistinguishable from the best", color=style.BAND, lw=7),
    ]
    style.legend_below(figure, handles)
    return figure


def correlated_laws(comparison: SteadyComparison) -> list[SteadyFit]:
    """The best law and the paper's, if they have several parameters."""
    names = dict.fromkeys([comparison.best, "exponential", "icr_radius"])
    known = [comparison.laws[name] for name in names if name in comparison.laws]
    return [law for law in known if len(law.values) > 1][:2]


@style.styled
def correlations(laws: Sequence[SteadyFit]) -> Figure:
    """Correlation matrices of the parameters of up to two laws."""
    figure, axes = style.subplots(3.7, 1, 2)
    axes[1].set_visible(len(laws) > 1)
    for axis, law in zip(axes, laws, strict=False):
        draw_matrix(axis, law.correlation, [symbol(law.name, name) for name in law.values], shown(law.name).label)
    return figure


def draw_matrix(axes: Axes, correlation: Array, symbols: Sequence[str], law: str) -> None:
    """Draw a cell for each pair of a law's parameters (f, f), red for positive correlation, blue for negative."""
    # polygons, because a bitmap would blur on the page
    axes.pcolormesh(correlation, cmap="RdBu_r", vmin=-1, vmax=1, edgecolors="white", linewidth=1.5)
    places = np.arange(len(symbols)) + 0.5
    axes.set_xticks(places, symbols)
    axes.set_yticks(places, symbols)
    axes.tick_params(length=0)
    axes.invert_yaxis()
    axes.set(aspect="equal", title=f"Correlations [–], {law}")
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    for (row, column), value in np.ndenumerate(correlation):
        text = "1" if row == column else f"{value:+.2f}".replace("-", "−")
        colour = "white" if abs(value) > _DARK else "black"
        axes.text(column + 0.5, row + 0.5, text, ha="center", va="center", color=colour)
