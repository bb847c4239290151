"""Calibration of the simulated robot: reading targets, and showing fits in tables and results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from experiments.calibrate.config import Config
from experiments.common.log_options import size_in_bytes
from experiments.common.table import Table, number
from experiments.simulate.options import GroundOptions
from sim.calibration.calibration import Calibration, Estimate, calibrate
from sim.calibration.candidate import OF_DRIVE, Candidate
from sim.calibration.targets import Drives, PublishedTurns, SteadyRows, Target
from sim.ground.ground import load_ground
from sim.robot.named import load_parameters
from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.source import ReadOptions, Source, read_source
from trackslip.kinematics import RobotGeometry
from trackslip.se2 import Mounting
from trackslip.views.numbers import with_interval
from trackslip.views.symbols import printed_unit

_METRICS: Final = {
    "v": ("v, rms", 1e3, 1, "mm/s"),
    "w": ("w, rms", 1e3, 1, "mrad/s"),
    "lateral": ("lateral speed, rms", 1e3, 1, "mm/s"),
    "slip": ("slip, rms", 1.0, 4, ""),
    "radius": ("radius, rms", 1e2, 2, "%"),
    "pull": ("pull / weight, rms", 1e2, 2, "%"),
    "position": ("position", 1.0, 3, "m"),
    "heading": ("heading", float(np.degrees(1.0)), 1, "°"),
}
"""Label, factor from SI, decimals and unit of each error, by the first part of its name."""
# least share of steady driving at which simulated runs are compared by steady samples [-]
_MIN_STEADY: Final = 0.5
_STATISTICS: Final = {"median": "median", "p90": "90 %"}


@dataclass(frozen=True)
class Test:
    """Errors on another log, to which only the clock offset is fitted, if it is free."""

    before: dict[str, float]
    calibrated: dict[str, float]
    clock_offset: float
    """Encoder clock minus pose clock in that log [s]."""


def first_candidate(
    robot: str,
    ground: GroundOptions,
    sensor: tuple[float, float, float] | None,
    clock: float | None,
) -> Candidate:
    """The robot before calibration, on the ground that the options name or, without a name, the
    robot's own ground.
    """
    parameters, own = load_parameters(robot)
    named = load_ground(ground.source) if ground.source else own
    mounting = Mounting(*sensor) if sensor else Mounting()
    return Candidate(parameters, ground.changed(named), mounting, clock or 0.0)


def read_target(name: str, config: Config, base: Candidate) -> Target:
    """The published target, or a target from a file; a log without a geometry gets that of `base`.
    Raises LogError.
    """
    if name == "published":
        return PublishedTurns(config.threads)
    reading = ReadOptions(
        gear=config.gear,
        bag=config.bag.choice(),
        layout=config.table.layout(),
        max_memory=size_in_bytes("max_memory", config.max_memory),
    )
    source = read_log_of(Path(name), reading, base.geometry)
    simulated = bool(source.logs) and all("plate" in log.metadata for log in source.logs)
    if not source.logs or (simulated and _steady(source)):
        samples = source.sampling.samples
        return SteadyRows(samples, source.geometry, simulated, threads=config.threads)
    fits_drive = bool(OF_DRIVE & set(config.free or ()))
    inputs: Literal["commands", "encoders"] = "commands" if fits_drive else "encoders"
    return Drives(source.logs, source.geometry, inputs, config.threads)


def read_log_of(path: Path, reading: ReadOptions, known: RobotGeometry | None) -> Source:
    """Read a log; if neither the log nor the options state the robot's size, the `known` geometry
    is used.
    """
    try:
        return read_source(path, reading)
    except InvalidValueError:
        if known is None:
            raise
        half_gauge = reading.half_gauge or known.half_gauge
        radius = reading.sprocket_radius or known.sprocket_radius
        return read_source(path, replace(reading, half_gauge=half_gauge, sprocket_radius=radius))


def _steady(source: Source) -> bool:
    """Whether the runs are mostly steady, as in a grid."""
    try:
        return source.sampling.steady_share >= _MIN_STEADY
    except LogError:
        return False


def fold_labels(target: Target, folds: int | None) -> np.ndarray | None:
    """Fold labels (n,) for a target's errors; folds are consecutive parts of the log. None without
    folds.
    """
    layout = target.layout
    if folds is None:
        return None
    if folds > layout.clusters:
        raise InvalidValueError("folds", folds, f"at most {layout.clusters}, for this target")
    return ((layout.cluster + 0.5) / layout.clusters * folds).astype(int)


def tested(target: Target, base: Candidate, fit: Calibration) -> Test:
    """Errors of `base` and `fit` on another target, each with its own clock offset if the clock is
    free.
    """
    candidates = [base, fit.candidate]
    if "clock" in fit.estimates and isinstance(target, Drives):
        fits = [calibrate(target, candidate, ("clock",)) for candidate in candidates]
        candidates = [clock_fit.candidate for clock_fit in fits]
    before, after = (target.metrics(target.errors(candidate)) for candidate in candidates)
    return Test(before, after, candidates[1].clock)


def fit_summary(fit: Calibration) -> dict[str, Any]:
    """A fit as an entry in summary.json: parameters with their errors, remaining errors, and values
    from each fold.
    """
    parameters = {
        name: {**vars(estimate), "identifiable": not estimate.vague}
        for name, estimate in fit.estimates.items()
    }
    folds = [{name: fold.value(name) for name in fit.estimates} for fold in fit.folds]
    summary = {"parameters": parameters, "correlation": fit.correlation, **fit.metrics}
    return summary | ({"folds": folds} if folds else {})


def summary_of(fit: Calibration, test: Test | None) -> dict[str, Any]:
    """Content of summary.json for a calibration."""
    place = fit.candidate.sensor
    summary = fit_summary(fit) | {
        "sensor": {
            "x": place.x,
            "y": place.y,
            "yaw": place.yaw,
            "clock_offset": fit.candidate.clock,
        },
        "before": fit.before,
    }
    if fit.held_out is not None:
        summary["held_out"] = {"before": fit.held_out_before, "calibrated": fit.held_out}
    if test is not None:
        summary["test"] = vars(test)
    return summary


def parameter_table(title: str, fit: Calibration) -> Table:
    """A table of the parameters with their intervals."""
    return Table(title, ("parameter", "fit (95 % interval)"), parameter_rows(fit))


def parameter_rows(fit: Calibration) -> list[tuple[str, str]]:
    """Rows with each parameter's name, and its value with interval."""
    return [(name, _parameter_text(name, estimate)) for name, estimate in fit.estimates.items()]


def _parameter_text(name: str, estimate: Estimate) -> str:
    unit = (1e2, "%") if name.startswith("radius") else printed_unit(estimate.unit)
    ends = None if estimate.vague else (estimate.low, estimate.high)
    return with_interval(estimate.value, ends, unit, why_none="not determined")


def error_table(fit: Calibration, test: Test | None) -> Table:
    """A table of the errors on the target, the held-out part and another log, before and after the
    fit.
    """
    columns = {"before": fit.before, "calibrated": fit.metrics}
    if fit.held_out is not None and fit.held_out_before is not None:
        columns |= {"held out, before": fit.held_out_before, "held out": fit.held_out}
    if test is not None:
        columns |= {"test, before": test.before, "test": test.calibrated}
    return Table(
        "Simulated minus measured", ("error", *columns), _metric_rows(list(columns.values()))
    )


def _metric_rows(metrics: Sequence[dict[str, float]]) -> list[tuple[str, ...]]:
    rows = []
    for name in metrics[0]:
        kind, _, rest = name.partition("_")
        label, factor, digits, unit = _METRICS[kind]
        ahead, _, statistic = rest.partition("_")
        if statistic:
            if statistic not in _STATISTICS:
                continue
            label = f"{label} after {ahead.removesuffix('s')} s, {_STATISTICS[statistic]}"
        values = (None if name not in column else factor * column[name] for column in metrics)
        rows.append((label, *(number(value, digits, unit) for value in values)))
    return rows


def remarks(fit: Calibration, test: Test | None) -> list[str]:
    """Lines on parameters that the target does not determine, and on the clock offset in the test
    log.
    """
    lines = [
        f"{name}: {estimate.vague}" for name, estimate in fit.estimates.items() if estimate.vague
    ]
    if test is not None and test.clock_offset != fit.candidate.clock:
        lines.append(f"the test log is predicted with --clock-offset={test.clock_offset:.3g}")
    return lines
