"""What notebooks show of a result: a small table with symbols and units."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import singledispatch
from html import escape

import numpy as np

from trackslip.benchmark import BenchmarkResults
from trackslip.errors import counted
from trackslip.identification.answer import TOO_LITTLE
from trackslip.identification.common_law import LOGS_DIFFER, MULTIPLIERS, LogComparison, ratio_text
from trackslip.identification.prediction import PredictionErrors, Statistics
from trackslip.identification.result import Identification
from trackslip.intervals import Gain
from trackslip.laws.base import SlipLaw
from trackslip.logs.runlog import RunLog
from trackslip.metrics import TrackingErrors
from trackslip.odometry.evaluation import OdometryErrors
from trackslip.views.numbers import MISSING, number, with_interval
from trackslip.views.values import law_parameters, multiplier_values, parameter_values


@dataclass(frozen=True)
class Summary:
    """A result as a small table."""

    title: str
    header: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    alarms: Sequence[str] = ()  # reasons not to trust the result, above the table
    notes: Sequence[str] = ()  # lines below the table


def html(result: object) -> str:
    """The HTML of a result's summary."""
    summary = _summary(result)
    alarms = [f"<p><strong>ALARM: {escape(line)}</strong></p>" for line in summary.alarms]
    rows = [f"<tr>{_cells('td', row)}</tr>" for row in summary.rows]
    notes = [f"<p>{escape(line)}</p>" for line in summary.notes]
    lines = [
        f"<p>{escape(summary.title)}</p>",
        *alarms,
        "<table>",
        f"<thead><tr>{_cells('th', summary.header)}</tr></thead>",
        "<tbody>",
        *rows,
        "</tbody>",
        "</table>",
        *notes,
    ]
    return "\n".join(lines) + "\n"


def _cells(tag: str, texts: Sequence[str]) -> str:
    """Cells of a row; text is aligned to the left, which notebooks don't do by themselves."""
    return "".join(
        f'<{tag} style="text-align: left; padding-right: 1em">{escape(text)}</{tag}>'
        for text in texts
    )


@singledispatch
def _summary(result: object) -> Summary:
    """The summary of a result, by its class or the next class above it."""
    raise NotImplementedError(f"{type(result).__name__} has no view")


@_summary.register(SlipLaw)
def _law(law: SlipLaw) -> Summary:
    rows = [(each.symbol, each.text, each.meaning) for each in law_parameters(law)]
    return Summary(f"Slip law {type(law).__name__}", ("parameter", "value", "meaning"), rows)


@_summary.register(RunLog)
def _log(log: RunLog) -> Summary:
    duration = log.time[-1] - log.time[0]
    interval = float(np.median(np.diff(log.time)))
    fastest = number(float(np.abs(log.omega).max()), 2, "rad/s")
    rows = [
        ("duration", f"{duration:.4g} s, {counted(len(log.time), 'row')}, every {interval:.3g} s"),
        ("encoders", f"{counted(int(log.is_read.sum()), 'reading')}, up to {fastest}"),
        ("poses", _poses(log)),
    ]
    if log.gyro is not None:
        share = np.isfinite(log.gyro).mean()
        rows.append(("gyro", f"in {100 * share:.3g} % of the rows"))
    geometry = log.metadata.get("geometry")
    if isinstance(geometry, Mapping):
        names = {"half_gauge": "b", "sprocket_radius": "r"}
        sizes = [f"{names[key]} = {geometry[key]:g} m" for key in names if key in geometry]
        rows.append(("robot", ", ".join(sizes)))
    known = {
        "command": "commanded sprocket speeds",
        "twist_command": "commanded twists",
        "truth": "true poses and twists",
        "scans": "scans",
    }
    others = [text for name, text in known.items() if getattr(log, name) is not None]
    if others:
        rows.append(("also", ", ".join(others)))
    return Summary(f"Run {log.run}", ("quantity", "value"), rows)


def _poses(log: RunLog) -> str:
    """How many poses were measured, and the area that they cover."""
    placed = log.pose[log.has_place, :2]
    headed = int(log.has_heading.sum())
    if not len(placed):
        return f"no positions, {counted(headed, 'heading')}"
    width, height = np.ptp(placed, axis=0)
    area = f"within {width:.3g} × {height:.3g} m"
    return f"{counted(len(placed), 'position')} {area}, {counted(headed, 'heading')}"


@_summary.register(Identification)
def _identification(result: Identification) -> Summary:
    drive = result.drive if result.method == "drive" else None
    if drive is not None:
        source = counted(len(drive.look.drives), "drive")
    else:
        source = counted(len(result.samples), "steady sample")
    fits = result.main.laws
    answer = result.expressible
    rows = [(name, value, answer or "") for name, value in multiplier_values(result)]
    for law in dict.fromkeys(name for name in (answer, result.best) if name is not None):
        rows += [(letter, value, law) for letter, value in parameter_values(fits[law])]
    robot = result.geometry
    title = (
        f"Slip laws from {source}. Best law: {result.best}. "
        f"Robot: b = {robot.half_gauge:g} m, r = {robot.sprocket_radius:g} m"
    )
    count = len(result.warnings)
    notes = [f"{counted(count, 'note')} in .warnings"] if count else []
    return Summary(
        title,
        ("parameter", "value (95 % interval)", "law"),
        rows,
        [alarm.line for alarm in result.alarms],
        notes,
    )


@_summary.register(OdometryErrors)
def _odometry(errors: OdometryErrors) -> Summary:
    rows = list[tuple[str, ...]]()
    for unit, by_length in (("m", errors.after_metres), ("s", errors.after_seconds)):
        for length, ahead in by_length.items():
            rows.append((f"{length:g} {unit}", f"{ahead.count:,}", *_error_cells(ahead)))
    drives = counted(len(errors.trajectories), "drive")
    header = ("after", "stretches", "position, median", "90 %", "heading, median", "90 %")
    return Summary(f"Odometry errors in {drives}", header, rows, notes=errors.notes)


def _error_cells(errors: PredictionErrors) -> list[str]:
    """Median and 90 % quantile of the errors in position and heading."""
    return [
        *_quantiles(errors.position, 1.0, 3, "m"),
        *_quantiles(errors.heading, math.degrees(1.0), 2, "°"),
    ]


def _quantiles(part: Statistics | None, factor: float, digits: int, unit: str) -> list[str]:
    """Median and 90 % quantile of errors, times `factor`."""
    if part is None:
        return [MISSING, MISSING]
    texts = [number(factor * value, digits, unit) for value in (part.median, part.p90)]
    return [text.replace(" °", "°") for text in texts]


@_summary.register(TrackingErrors)
def _tracking(errors: TrackingErrors) -> Summary:
    kept = "yes" if errors.success else "no"
    rows = [
        ("position, rms", _millimetres(errors.rms_position)),
        ("position, rms from 12 s on", _millimetres(errors.rms_position_after_12s)),
        ("position, rms in turns", _millimetres(errors.rms_position_arc)),
        ("position, largest", _millimetres(errors.max_position)),
        ("position, at the end", _millimetres(errors.final_position)),
        ("across the path, rms", _millimetres(errors.cross_track)),
        ("heading, rms", f"{math.degrees(errors.rms_heading):.2f}°"),
        ("heading, at the end", f"{math.degrees(errors.final_heading):.2f}°"),
        ("stayed within 0.5 m", kept),
    ]
    return Summary("Tracking errors", ("error", "value"), rows)


def _millimetres(metres: float | None) -> str:
    return number(None if metres is None else 1e3 * metres, 1, "mm")


@_summary.register(BenchmarkResults)
def _benchmark(results: BenchmarkResults) -> Summary:
    rows = list[tuple[str, ...]]()
    for entry in results.entries:
        ends = entry["score_ci95"]
        error = _millimetres(entry["score"])
        if ends is not None:
            error += f" ({number(1e3 * ends[0], 1)} to {number(1e3 * ends[1], 1)})"
        rows.append(
            (
                str(entry["rank"]),
                entry["controller"],
                entry["compensation"],
                entry["start"],
                error,
                number(entry["gain"], 1),
                number(100 * entry["success"], 0, "%"),
            )
        )
    header = ("rank", "controller", "compensation", "start", "error (95 %)", "gain", "kept")
    note = (
        "Error: rms position error from 12 s on, 0.5 m for a run that lost the path. Gain: the "
        "error without compensation over this one. Kept: runs that stayed within 0.5 m."
    )
    title = f"Benchmark, {counted(len(results.runs), 'run')}"
    return Summary(title, header, rows, notes=[note])


@_summary.register(LogComparison)
def _comparison(comparison: LogComparison) -> Summary:
    rows = list[tuple[str, ...]]()
    for name, cost in comparison.costs.items():
        values = [_gain(gain) for gain in comparison.values[name].values()]
        ratio = MISSING if math.isnan(cost.ratio.value) else ratio_text(cost.ratio)
        rows.append((name, *values, ratio, cost.verdict))
    rows.append(
        ("mean", *(_gain(comparison.common[key], LOGS_DIFFER) for key in MULTIPLIERS), "", "")
    )
    names = [key.replace("_", " ") for key in MULTIPLIERS]
    header = ("log", *names, "error by the other logs' law over own", "served by one law")
    return Summary(comparison.line, header, rows)


def _gain(gain: Gain, why_none: str = TOO_LITTLE) -> str:
    """A value with its interval."""
    if math.isnan(gain.value):
        return MISSING
    return with_interval(gain.value, gain[1:], why_none=why_none)
