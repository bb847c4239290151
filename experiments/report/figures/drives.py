"""Figures of laws identified from whole drives: residuals over time, the clock, correlations, prediction errors."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from experiments.report.colours import BLUE, GREEN, GREY, ORANGE, RED
from experiments.report.drives import title_of
from experiments.report.figures.laws import draw_matrix
from experiments.report.figures.style import BAND, law_line, legend_below, styled, subplots
from experiments.report.law_symbols import EXTRA_SYMBOLS, SYMBOLS
from trackslip.identification.drive.comparison import DriveComparison
from trackslip.identification.drive.estimate import DriveFit
from trackslip.identification.drive.fit import Fit
from trackslip.identification.drive.prediction import HORIZONS
from trackslip.identification.drive.residuals import Nodes
from trackslip.kinematics import Array, wrap_angle

_POINTS = 1200  # of a panel
_WITHIN = 1.96  # standard deviations of 95 % of normal residuals
_RISE = 3.84  # of -2 log likelihood at the ends of a 95 % interval


@styled
def residuals_over_time(law: DriveFit) -> Figure:
    """Residuals of poses and steps, drive after drive."""
    fit = law.fit
    time, begins = _joined_time(fit)
    pose, kept = pose_residuals(fit)
    step, linked = step_residuals(fit)
    headings = bool(np.isfinite(pose[:, 2]).any())
    panels: list[tuple[str, Array, np.ndarray, Array, float]] = [
        ("position [mm]", 1e3 * pose[:, :2], kept, time, 1e3 * law.noise["position"]),
    ]
    if headings:
        panels.append(("heading [°]", np.degrees(pose[:, 2:]), kept, time, np.degrees(law.noise["heading"])))
    panels.append(("slip of a step [–]", step, linked, (time[1:] + time[:-1]) / 2, 1.0))
    figure, axes = subplots(1.9 * len(panels) + 0.4, len(panels), sharex=True, down=0.4)
    for axis, (label, values, used, at, deviation) in zip(axes, panels, strict=True):
        names = ("forwards", "sideways", "in turning") if label.startswith("slip") else ("x", "y")
        _residual_panel(axis, at, values, used, names if values.shape[1] > 1 else ("",))
        if used is kept:  # slips are smoothed: their scatter is much smaller than their standard deviation
            axis.axhspan(-_WITHIN * deviation, _WITHIN * deviation, color=BAND, lw=0, zorder=0)
        for begin in begins[1:]:
            axis.axvline(begin, color=GREY, lw=0.8, ls=":")
        axis.set_ylabel(label)
    axes[0].set_title("Poses: trajectory − measured")
    axes[-1].set_title("Steps: motion − law, in standard deviations")
    axes[-1].set_xlabel("time, drive after drive [s]" if len(begins) > 1 else "time [s]")
    axes[0].set_xlim(0, time[-1])
    handles = [Line2D([], [], color=BAND, lw=7, label="95 % of normal residuals")]
    if not (kept.all() and linked.all()):
        handles.append(Line2D([], [], ls="none", marker="x", ms=5, color=RED, label="left out (at the edge if beyond)"))
    legend_below(figure, handles, ncols=2)
    return figure


def pose_residuals(fit: Fit) -> tuple[Array, np.ndarray]:
    """Trajectory minus measured poses (K, 3) [m, m, rad], NaN where not measured; and whether each was kept (K,)."""
    measured = Nodes.of(fit.nodes.drives)
    error = fit.states - fit.nodes.pose
    error[:, 2] = wrap_angle(error[:, 2] + fit.values[fit.model.index("sensor_yaw")])
    return error, fit.nodes.weight[:, 0] == measured.weight[:, 0]


def step_residuals(fit: Fit) -> tuple[Array, np.ndarray]:
    """Slip of each step (K - 1, 3) [standard deviations], NaN between drives; and whether each was kept (K - 1,)."""
    measured = Nodes.of(fit.nodes.drives)
    scaled = fit.residuals.step / (np.sqrt(fit.residuals.distance)[:, None] * fit.noise.values[2:])
    return np.where(measured.link[:, None] > 0, scaled, np.nan), fit.nodes.link == measured.link


def _joined_time(fit: Fit) -> tuple[Array, list[float]]:
    """Times (K,) of the nodes as if each drive began where the one before ended, and those beginnings [s]."""
    times, begins, end = [], [], 0.0
    for drive in fit.nodes.drives:
        begins.append(end)
        times.append(end + drive.time - drive.time[0])
        end = float(times[-1][-1])
    return np.concatenate(times), begins


def _residual_panel(axis: Axes, time: Array, values: Array, used: np.ndarray, names: Sequence[str]) -> None:
    """Draw residuals (n, m), thinned out; those left out as crosses, at the edge where they lie beyond."""
    finite = np.isfinite(values).all(axis=1)
    rows = np.flatnonzero(finite & used)
    rows = rows[:: max(1, len(rows) * len(names) // _POINTS)]
    for column, (name, colour) in enumerate(zip(names, (BLUE, ORANGE, GREEN), strict=False)):
        axis.plot(time[rows], values[rows, column], ".", color=colour, ms=2.6, mew=0, label=name)
    edge = 1.15 * float(np.abs(values[finite & used]).max(initial=1e-9))
    out = np.flatnonzero(finite & ~used)[:_POINTS]
    if len(out):
        worst = values[out, np.abs(values[out]).argmax(axis=1)]
        axis.plot(time[out], np.clip(worst, -edge, edge), "x", color=RED, ms=4.5, mew=1.0, zorder=5)
    axis.set_ylim(-1.1 * edge, 1.1 * edge)
    if len(names) > 1:
        style: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1, 0.98), "borderaxespad": 0}
        axis.legend(ncols=3, markerscale=3.0, handletextpad=0.1, columnspacing=1.0, **style)


@styled
def clock_offset(found: DriveComparison) -> Figure:
    """Rise of -2 log likelihood with the clock offset, and the 95 % interval; raises ValueError if it was held."""
    if found.clock is None:
        raise ValueError("the clock offset was held")
    law = found.laws[found.best]
    figure, axis = subplots(3.2)
    axis.plot(1e3 * found.clock.offset, np.maximum(found.clock.rise, 0.0), "o-", color=BLUE, ms=4)
    axis.axhline(_RISE, color=RED, ls="--", lw=1.2, label=f"rise of {_RISE}: 95 % by the likelihood")
    low, high = (1e3 * end for end in law.interval95["clock_offset"])
    axis.axvspan(low, high, color=BAND, lw=0, zorder=0, label="95 % interval, wider where slip lasts")
    axis.set(xlabel="encoder clock − pose clock τ [ms]", ylabel="rise of −2 log L [–]", title="Clock offset")
    axis.set_ylim(bottom=0)
    legend_below(figure, axis.get_legend_handles_labels()[0], ncols=2)
    return figure


@styled
def drive_correlations(law: DriveFit) -> Figure:
    """Correlation matrix of all parameters fitted."""
    symbols = SYMBOLS | EXTRA_SYMBOLS
    figure, axis = subplots(1.2 + 0.38 * len(law.free))
    draw_matrix(axis, law.correlation, [symbols[name] for name in law.free])
    axis.set_title(f"Correlations [–], {title_of(law.name)}")
    return figure


@styled
def prediction_errors(found: DriveComparison) -> Figure:
    """Errors of prediction against the horizon, by law; position, and heading where it was measured."""
    kinds = [("position_rms", 1.0, "Position", "rms error [m]")]
    if any(drive.has_heading for drive in found.drives):
        kinds.append(("heading_rms", np.degrees(1.0), "Heading", "rms error [°]"))
    figure, axes = subplots(3.6, 1, len(kinds), squeeze=False)
    for axis, (key, factor, title, label) in zip(axes[0], kinds, strict=True):
        for name in reversed(found.ranking):
            points = [(h, factor * value) for h, e in found.errors[name].items() if (value := getattr(e, key))]
            if points:
                axis.plot(*np.transpose(points), marker="o", ms=3.5, **_look(name, found))
        axis.set(title=title, xlabel="time ahead [s]", ylabel=label, xscale="log", yscale="log")
        axis.set_xticks(HORIZONS, [f"{horizon:g}" for horizon in HORIZONS])
        axis.set_xticks([], minor=True)
        axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.yaxis.set_major_formatter("{x:g}")
        axis.yaxis.set_minor_formatter(NullFormatter())
    handles = [Line2D([], [], **_look(name, found)) for name in found.ranking]
    legend_below(figure, handles, ncols=4, handlelength=3.2)
    return figure


def _look(name: str, found: DriveComparison) -> dict[str, Any]:
    best = name == found.best
    return law_line(name, label=title_of(name) + (" – best" if best else ""), lw=2.2 if best else 1.2)
