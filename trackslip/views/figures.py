"""Figures of results, with matplotlib."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from functools import singledispatch
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from trackslip.benchmark import BenchmarkResults
from trackslip.identification.common_law import MULTIPLIERS, NOTICED, LogComparison
from trackslip.identification.drive_comparison import TODAY, DriveComparison
from trackslip.identification.prediction import PredictionErrors
from trackslip.identification.result import Identification
from trackslip.identification.steady import SteadyComparison
from trackslip.intervals import Gain
from trackslip.kinematics import Array
from trackslip.laws.base import SlipLaw
from trackslip.logs.runlog import RunLog
from trackslip.metrics import TrackingErrors
from trackslip.odometry.evaluation import OdometryErrors

_WIDTH: Final = 9.0  # width of a figure [in]
_HEIGHT: Final = 3.4  # height of a figure with axes side by side [in]
_ROW: Final = 0.35  # height of a row of bars [in]
_LEFT: Final = "#1f6fb2"
_RIGHT: Final = "#d0662a"
_MEASURED: Final = "#444444"
_OTHERS: Final = "#b5b5b5"
_POLE: Final = 1.0  # slip above which a law is near its pole [-]
_SHARPEST: Final = 89.0  # sharpness up to which laws are drawn [°]
_USUAL_HALF_GAUGE: Final = 0.25  # for laws that don't state the robot's [m]
_SPEED: Final = 0.3  # speed at which laws that depend on it are drawn [m/s]
_MOST_POINTS: Final = 2000  # most points of a line
_QUANTITIES: Final = (("position", "m", 1.0), ("heading", "°", math.degrees(1.0)))
"""Errors, with printed unit and factor from SI."""


class NotebookFigure(Figure):
    """A figure that notebooks show, although it doesn't come from pyplot."""

    def _repr_png_(self) -> bytes:
        image = io.BytesIO()
        self.savefig(image, format="png", dpi=100, metadata={"Software": None})
        return image.getvalue()


def plot(result: object, figure: Figure | None = None) -> Figure:
    """Draw a result into a `figure`, by default a new one."""
    if figure is None:
        figure = NotebookFigure(figsize=(_WIDTH, _HEIGHT))
    figure.set_layout_engine("constrained")
    _draw(result, figure)
    for axes in figure.axes:
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color="#e4e4e4", linewidth=0.7)
        axes.set_axisbelow(True)
    return figure


@singledispatch
def _draw(result: object, figure: Figure) -> None:
    """Draw a result, by its class or the next class above it."""
    raise NotImplementedError(f"{type(result).__name__} has no view")


@_draw.register(SlipLaw)
def _law(law: SlipLaw, figure: Figure) -> None:
    """Slip of both tracks against the sharpness of the turn."""
    axes = figure.subplots()
    half_gauge = float(np.max(np.asarray(getattr(law, "half_gauge", _USUAL_HALF_GAUGE), float)))
    _draw_law(axes, law, half_gauge)
    speed = f" at {_SPEED:g} m/s" if _depends_on_speed(law) else ""
    _label_slip(axes, f"{type(law).__name__}{speed}", half_gauge)


def _draw_law(axes: Axes, law: SlipLaw, half_gauge: float) -> None:
    """Lines of the slips by a law from turns on the spot to the right to those to the left."""
    sharpness = np.radians(np.linspace(-_SHARPEST, _SHARPEST, 601))
    plane = np.column_stack([np.cos(sharpness), np.sin(sharpness) / half_gauge])
    slip = _slips(law, _SPEED * plane)
    with np.errstate(invalid="ignore"):
        drawn = np.where(np.abs(slip) < _POLE, slip, np.nan)
    for track, (name, colour) in enumerate((("left", _LEFT), ("right", _RIGHT))):
        lines = axes.plot(np.degrees(sharpness), drawn[..., track], color=colour)
        lines[0].set_label(f"{name} track")


def _slips(law: SlipLaw, twists: Array) -> Array:
    """Slips (n, 2) of a law at twists (n, 2), or (n, laws, 2) of many laws."""
    try:
        return law.slip(twists)
    except ValueError:  # the laws' shape isn't that of the twists
        return law.slip(twists[:, None, :])


def _depends_on_speed(law: SlipLaw) -> bool:
    """Whether a law's slip on the same path differs between two speeds."""
    slow = _slips(law, np.array([[_SPEED, _SPEED]]))
    fast = _slips(law, np.array([[2 * _SPEED, 2 * _SPEED]]))
    return not np.allclose(slow, fast, equal_nan=True)


def _label_slip(axes: Axes, title: str, half_gauge: float) -> None:
    axes.axhline(0.0, color="#888888", linewidth=0.8)
    sharpness = f"atan(b / R) [°], b = {half_gauge:g} m: 0 straight, 90 left turn on the spot"
    axes.set(title=title, xlabel=sharpness, ylabel="slip [-]", xlim=(-90.0, 90.0))
    axes.set_xticks(range(-90, 91, 30))
    axes.legend(frameon=False)


@_draw.register(RunLog)
def _log(log: RunLog, figure: Figure) -> None:
    """The measured path, and the sprocket speeds over time."""
    path, speeds = figure.subplots(1, 2)
    rows = slice(None, None, max(1, len(log.time) // _MOST_POINTS))
    placed = log.pose[log.has_place]
    if len(placed):
        few = placed[:: max(1, len(placed) // _MOST_POINTS)]
        path.plot(few[:, 0], few[:, 1], color=_MEASURED, linewidth=1.2)
        path.plot(*placed[0, :2], "o", color=_MEASURED, label="start")
        path.set(title="Measured path", xlabel="x [m]", ylabel="y [m]")
        path.set_aspect("equal", adjustable="datalim")
        path.legend(frameon=False)
    else:
        headed = log.has_heading
        degrees = np.degrees(log.pose[headed, 2])
        path.plot(log.time[headed], degrees, ".", color=_MEASURED, markersize=3)
        path.set(title="Measured heading", xlabel="time [s]", ylabel="heading [°]")
    for track, (name, colour) in enumerate((("left", _LEFT), ("right", _RIGHT))):
        speeds.plot(log.time[rows], log.omega[rows, track], color=colour, linewidth=1.0, label=name)
    speeds.set(title="Sprocket speeds", xlabel="time [s]", ylabel="speed [rad/s]")
    speeds.legend(frameon=False)


@_draw.register(Identification)
def _identification(result: Identification, figure: Figure) -> None:
    """Slips of steady stretches with the best law, or errors of predictions by all laws."""
    if result.method == "drive" and result.drive is not None:
        _predictions(result.drive, figure)
    else:
        _steady(result.comparison, result.geometry.half_gauge, figure)


def _steady(steady: SteadyComparison, half_gauge: float, figure: Figure) -> None:
    """Slips of both tracks in steady stretches, with the best law."""
    axes = figure.subplots()
    samples = steady.samples
    forwards, turn = samples.twist.T
    # driving backwards, the path bends to the same side
    direction = np.where(forwards < 0, -1.0, 1.0)
    sharpness = np.arctan2(direction * half_gauge * turn, direction * forwards)
    with np.errstate(invalid="ignore"):
        slip = np.where(np.abs(samples.slip) < _POLE, samples.slip, np.nan)
    for track, colour in enumerate((_LEFT, _RIGHT)):
        axes.plot(np.degrees(sharpness), slip[:, track], "o", color=colour, markersize=3)
    _draw_law(axes, steady.laws[steady.best].law, half_gauge)
    _label_slip(axes, f"Measured slip (dots) and law {steady.best}", half_gauge)


def _predictions(drive: DriveComparison, figure: Figure) -> None:
    """Median errors of predictions of held-out driving against the time ahead."""
    for axes, (quantity, unit, factor) in zip(figure.subplots(1, 2), _QUANTITIES, strict=True):
        for law, by_horizon in drive.errors.items():
            known = _medians(by_horizon, quantity)
            if not known:
                continue
            look: dict[str, Any] = {"color": _OTHERS, "linewidth": 1.0, "label": "_other"}
            if law == drive.best:
                look = {"color": _LEFT, "linewidth": 2.5, "label": f"{law} (best)", "zorder": 3}
            elif law == TODAY:
                look = {"color": _RIGHT, "linestyle": "--", "label": "today, without slip"}
            ahead = list(known)
            axes.plot(
                ahead, [factor * known[time] for time in ahead], marker="o", markersize=4, **look
            )
        axes.set(title=quantity.capitalize(), xlabel="time ahead [s]")
        axes.set_ylabel(f"median error [{unit}]")
        _legend_or_reason(axes)
    figure.suptitle("Predictions of held-out driving; grey: other laws", fontsize="medium")


def _medians(by_length: Mapping[float, PredictionErrors], quantity: str) -> dict[float, float]:
    """Known median errors of a `quantity` by time or distance ahead."""
    parts = {length: getattr(errors, quantity) for length, errors in by_length.items()}
    return {length: part.median for length, part in parts.items() if part is not None}


def _legend_or_reason(axes: Axes) -> None:
    """A legend, or that nothing was measured that errors could be computed from."""
    if axes.lines:
        axes.set_ylim(bottom=0.0)
        axes.legend(frameon=False)
    else:
        axes.text(0.5, 0.5, "not measured", transform=axes.transAxes, ha="center")


@_draw.register(OdometryErrors)
def _odometry(errors: OdometryErrors, figure: Figure) -> None:
    """Median and 90 % quantile of the errors against the distance driven."""
    for axes, (quantity, unit, factor) in zip(figure.subplots(1, 2), _QUANTITIES, strict=True):
        by_length = errors.after_metres or errors.after_seconds
        parts = {length: getattr(ahead, quantity) for length, ahead in by_length.items()}
        known = {length: part for length, part in parts.items() if part is not None}
        if known:
            lengths = list(known)
            median = [factor * part.median for part in known.values()]
            most = [factor * part.p90 for part in known.values()]
            axes.plot(lengths, median, "o-", color=_LEFT, label="median")
            axes.plot(lengths, most, "o--", color=_OTHERS, label="90 % are below")
        along = "distance driven [m]" if errors.after_metres else "time [s]"
        axes.set(title=quantity.capitalize(), xlabel=along, ylabel=f"error [{unit}]")
        _legend_or_reason(axes)


@_draw.register(TrackingErrors)
def _tracking(errors: TrackingErrors, figure: Figure) -> None:
    """Position errors as bars."""
    axes = figure.subplots()
    bars = {
        "rms": errors.rms_position,
        "rms from 12 s on": errors.rms_position_after_12s,
        "rms in turns": errors.rms_position_arc,
        "rms across the path": errors.cross_track,
        "at the end": errors.final_position,
        "largest": errors.max_position,
    }
    known = {name: 1e3 * value for name, value in bars.items() if math.isfinite(value)}
    axes.barh([*known], [*known.values()], color=_LEFT)
    axes.invert_yaxis()
    axes.set(title="Position errors", xlabel="error [mm]")


@_draw.register(BenchmarkResults)
def _benchmark(results: BenchmarkResults, figure: Figure) -> None:
    """Mean errors of all entries, with intervals."""
    entries = results.entries
    figure.set_size_inches(figure.get_figwidth(), max(2.0, 1.0 + _ROW * len(entries)))
    axes = figure.subplots()
    labels = [f"{entry['controller']}, {entry['compensation']}" for entry in entries]
    if len({entry["start"] for entry in entries}) > 1:
        labels = [
            f"{label}, {entry['start']}" for label, entry in zip(labels, entries, strict=True)
        ]
    for row, entry in enumerate(entries):
        ends = entry["score_ci95"]
        if ends is not None:
            axes.plot(1e3 * np.array(ends), [row, row], color=_LEFT, linewidth=2.0)
        axes.plot(1e3 * entry["score"], row, "o", color=_LEFT)
    axes.set_yticks(range(len(entries)), labels)
    axes.set_ylim(len(entries) - 0.5, -0.5)
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=8))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set(title="Benchmark", xlabel="rms position error from 12 s on [mm], with 95 % interval")


@_draw.register(LogComparison)
def _comparison(comparison: LogComparison, figure: Figure) -> None:
    """A forest plot of each multiplier, and the cost of one law for all."""
    rows = 1 + len(comparison.results)
    figure.set_size_inches(figure.get_figwidth(), 1.3 + _ROW * rows)
    *of_multipliers, of_costs = figure.subplots(1, len(MULTIPLIERS) + 1, sharey=True)
    draw_costs(of_costs, comparison)
    for axes, key in zip(of_multipliers, MULTIPLIERS, strict=True):
        draw_multiplier(axes, comparison, key)
        axes.set_title(key.removesuffix("_multiplier").replace("_", " "), fontsize="medium")
    of_costs.set_title("error ratio", fontsize="medium")


def draw_multiplier(axes: Axes, comparison: LogComparison, key: str) -> None:
    """A multiplier of all logs with intervals, and their mean, as a forest plot."""
    rows = {name: of_log[key] for name, of_log in comparison.values.items()}
    _forest(axes, rows)
    _interval(axes, len(rows), comparison.common[key], _MEASURED, "D")
    axes.axhline(len(rows) - 0.5, color=_OTHERS, linewidth=0.8)
    _label_rows(axes, [*rows, "mean"])
    axes.set_xlabel("multiplier [-]")


def draw_costs(axes: Axes, comparison: LogComparison) -> None:
    """The ratio of errors by the law of the other logs to those by each log's own."""
    rows = {name: cost.ratio for name, cost in comparison.costs.items()}
    axes.axvline(1.0, color=_MEASURED, linewidth=0.8)
    axes.axvline(NOTICED, color=_RIGHT, linewidth=0.8, linestyle="--")
    _forest(axes, rows)
    _label_rows(axes, [*rows])
    axes.set_xlabel(f"error by the other logs' law over own; dashed: {NOTICED:g}")


def _forest(axes: Axes, rows: Mapping[str, Gain]) -> None:
    """Values with intervals, a row for each; values without an interval are hollow."""
    for row, gain in enumerate(rows.values()):
        if math.isnan(gain.value):
            middle = axes.get_yaxis_transform()
            axes.text(0.5, row, "unknown", transform=middle, ha="center", va="center")
        else:
            _interval(axes, row, gain, _LEFT, "o")


def _interval(axes: Axes, row: int, gain: Gain, colour: str, marker: str) -> None:
    """A value with its interval in a row."""
    is_known = math.isfinite(gain.error)
    if is_known:
        axes.plot([gain.low, gain.high], [row, row], color=colour, linewidth=2.0)
    axes.plot(gain.value, row, marker, color=colour, markerfacecolor=None if is_known else "none")


def _label_rows(axes: Axes, names: Sequence[str]) -> None:
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
