"""Figures that hold the slip laws against each other: criteria side by side, and correlations of their parameters."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.report.figures.style import BAND, COLOURS, GREEN, LABELS, styled
from experiments.report.law_symbols import SYMBOLS
from trackslip.identification.comparison import Comparison
from trackslip.identification.fitted import FittedLaw

_INDISTINCT = 2.0  # difference of AICc that decides nothing
_DARK = 0.6  # correlation whose cell is too dark for black text
_DECIDED = 10.0  # difference of AICc up to which the axis is linear


@styled
def criteria(comparison: Comparison) -> Figure:
    """AICc above the smallest, and the errors of predicting left-out radii and speeds, a row a law, the best on top."""
    names = comparison.ranking
    validation = comparison.validation
    figure = Figure(figsize=(9.0, 1.7 + 0.27 * len(names)), layout="constrained")
    axes = figure.subplots(1, 4, sharey=True)
    known = [value for value in comparison.aicc.values() if value is not None]
    above = {name: None if value is None else value - min(known) for name, value in comparison.aicc.items()}
    fitted = {name: law.rms for name, law in comparison.laws.items()}
    _dots(axes[0], {name: above[name] for name in names})
    axes[0].axvspan(0, _INDISTINCT, color=BAND, lw=0, zorder=0)
    axes[0].set_xscale("symlog", linthresh=_DECIDED)
    axes[0].set_xlim(-0.8, None)
    for axis, values, more in (
        (axes[1], {name: validation[name].radius for name in names}, fitted),
        (axes[2], {name: validation[name].speed for name in names}, fitted),
        (axes[3], {name: _milli(validation[name].yaw_rate) for name in names}, {}),
    ):
        _dots(axis, values, more)
        if any(value is not None and value > 0 for value in values.values()):
            axis.set_xscale("log")
            axis.margins(x=0.12)
    for axis, title, label in (
        (axes[0], "Criterion", "AICc − smallest [–]"),
        (axes[1], "Radius left out", "slip, rms [–]"),
        (axes[2], "Speed left out", "slip, rms [–]"),
        (axes[3], "Radius left out", "yaw rate, rms [mrad/s]"),
    ):
        axis.set(title=title, xlabel=label)
    axes[0].set_yticks(range(len(names)), [LABELS.get(name, name) for name in names])
    axes[0].set_ylim(len(names) - 0.4, -0.6)
    axes[0].get_yticklabels()[names.index(comparison.best)].set_fontweight("bold")
    handles = [
        Line2D([], [], marker="o", ls="none", color="#555555", label="of runs left out of the fit"),
        Line2D([], [], marker="o", ls="none", mfc="none", color="#555555", label="of the runs fitted"),
        Line2D([], [], color=BAND, lw=7, label="too near to the best to tell"),
    ]
    figure.legend(handles=handles, ncols=3, loc="outside lower center")
    return figure


def _milli(value: float | None) -> float | None:
    return None if value is None else 1e3 * value


def _dots(axis: Axes, values: Mapping[str, float | None], hollow: Mapping[str, float] | None = None) -> None:
    """A dot a law at its value, and a hollow one at another; a word where there is none."""
    for row, (name, value) in enumerate(values.items()):
        colour = COLOURS.get(name, GREEN)
        if value is None:
            beside = axis.get_yaxis_transform()
            axis.text(0.5, row, "not known", transform=beside, va="center", ha="center", fontsize=7.5, color="#666666")
            continue
        axis.plot(value, row, "o", color=colour, ms=6)
        if hollow:
            axis.plot(hollow[name], row, "o", color=colour, ms=8.5, mfc="none")


def correlated_laws(comparison: Comparison) -> list[FittedLaw]:
    """The best law and the paper's, as far as they have several parameters."""
    names = dict.fromkeys([comparison.best, "exponential", "icr_radius"])
    several = [
        comparison.laws[name] for name in names if name in comparison.laws and len(comparison.laws[name].values) > 1
    ]
    return several[:2]


@styled
def correlations(laws: list[FittedLaw]) -> Figure:
    """Correlation matrices of the parameters of up to two laws."""
    figure = Figure(figsize=(9.0, 3.7), layout="constrained")
    for axis, law in zip(figure.subplots(1, 2), laws, strict=False):
        _matrix(axis, law)
    for axis in figure.axes[len(laws) :]:
        axis.set_visible(False)
    return figure


def _matrix(axis: Axes, law: FittedLaw) -> None:
    """A cell for each pair of parameters, red where the correlation is positive, blue where it is negative."""
    # cells as polygons, for a bitmap would blur in the page
    axis.pcolormesh(law.correlation, cmap="RdBu_r", vmin=-1, vmax=1, edgecolors="white", linewidth=1.5)
    names = [SYMBOLS.get(key, key) for key in law.values]
    places = np.arange(len(names)) + 0.5
    axis.set_xticks(places, names)
    axis.set_yticks(places, names)
    axis.tick_params(length=0)
    axis.invert_yaxis()
    axis.set(aspect="equal", title=f"Correlations [–], {LABELS.get(law.name, law.name)}")
    axis.grid(visible=False)
    axis.spines[:].set_visible(False)
    for (row, column), value in np.ndenumerate(law.correlation):
        text = "1" if row == column else f"{value:+.2f}".replace("-", "−")
        colour = "white" if abs(value) > _DARK else "black"
        axis.text(column + 0.5, row + 0.5, text, ha="center", va="center", color=colour)
