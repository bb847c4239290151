"""Calibration of the simulated robot: its targets, and its fits as results and as tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.calibrate.config import Config
from experiments.common.formats import MISSING, number
from experiments.common.laws import printed_unit, with_error
from experiments.common.table import Table
from sim.calibration.calibration import Calibration, Estimate, calibrate
from sim.calibration.candidate import OF_DRIVE, Candidate
from sim.calibration.targets import Drives, SteadyRows, Target, TurnTable
from trackslip.errors import InvalidValueError, LogError, counted
from trackslip.identification.source import ReadOptions, Source, read_source
from trackslip.logs.logfile import read_table
from trackslip.logs.table import read_columns

TABLE_COLUMNS = ("radius", "speed", "observed_radius", "slip_outer", "slip_inner")
_METRICS = {
    "v": ("v, rms", 1e3, 1, "mm/s"),
    "w": ("w, rms", 1e3, 1, "mrad/s"),
    "lateral": ("lateral speed, rms", 1e3, 1, "mm/s"),
    "slip": ("slip, rms", 1.0, 4, ""),
    "radius": ("radius, rms", 1e2, 2, "%"),
    "position": ("position", 1.0, 3, "m"),
    "heading": ("heading", float(np.degrees(1.0)), 1, "°"),
}
"""Name, factor, decimals and unit of errors, by the first part of their names."""
_MIN_STEADY = 0.5  # share of the driving that is steady, of simulated runs compared by their steady samples [-]
_STATISTICS = {"median": "median", "p90": "90 %"}


def read_target(name: str, config: Config, base: Candidate) -> Target:
    """The published target, or that in a file, the base's geometry being used for a log without; raises LogError."""
    if name == "published":
        return TurnTable.published(config.threads)
    path, geometry = Path(name), base.geometry
    if path.suffix.lower() in (".csv", ".parquet"):
        table = read_table(path)
        if set(TABLE_COLUMNS) & set(table.column_names):
            return _turn_table(read_columns(table, TABLE_COLUMNS, name), name, config.threads)
    reading = ReadOptions(gear=config.gear, bag=config.bag.choice())
    try:
        source = read_source(path, reading)
    except InvalidValueError:  # the log contains no geometry
        b, r = geometry.half_gauge, geometry.sprocket_radius
        source = read_source(path, replace(reading, half_gauge=b, sprocket_radius=r))
    simulated = bool(source.logs) and all("plate" in log.metadata for log in source.logs)
    if not source.logs or (simulated and _steady(source)):
        return SteadyRows(source.sampling.samples, source.geometry, simulated, threads=config.threads)
    commands = bool(OF_DRIVE & set(config.free or ()))
    return Drives(source.logs, source.geometry, "commands" if commands else "encoders", config.threads)


def _steady(source: Source) -> bool:
    """True if the runs are mostly steady, as those of a grid are."""
    try:
        return source.sampling.steady_share >= _MIN_STEADY
    except LogError:
        return False


def _turn_table(columns: Any, name: str, threads: int) -> TurnTable:
    for label, column in zip(TABLE_COLUMNS, columns.T, strict=True):
        wrong, allowed = (column >= 1, "< 1") if label.startswith("slip") else (column <= 0, "> 0")
        if np.any(wrong):
            row = int(np.argmax(wrong))
            raise LogError(f"{name}: row {row + 1}, column {label}: {column[row]:g} must be {allowed}")
    radius, speed, observed, outer, inner = columns.T
    slip = np.stack([inner, outer], axis=-1)
    return TurnTable(radius, speed, observed, slip, 3 * len(columns), threads=threads)


def fold_labels(target: Target, hold_out: float | None, folds: int | None) -> np.ndarray | None:
    """Labels (n,) of the folds of a target's errors, parts in the order of the log; None without."""
    layout = target.layout
    place = (layout.cluster + 0.5) / layout.clusters
    if hold_out is not None:
        label = np.where(place > 1 - hold_out, 0, -1)
        if len(np.unique(label)) < 2:
            raise InvalidValueError("hold_out", hold_out, f"a share of {layout.clusters} independent parts of the log")
        return label
    if folds is None:
        return None
    if folds > layout.clusters:
        raise InvalidValueError("folds", folds, f"at most {layout.clusters}, for this target")
    return (place * folds).astype(int)


def variants(target: Target, base: Candidate, best: Calibration) -> dict[str, Calibration]:
    """Fits to compare with the best one, by title: with a centred mass, and by theory to the slips alone."""
    if isinstance(target, Drives):
        return {}
    found, free = {}, list(best.estimates)
    rest = [name for name in free if name != "com_y"]
    if 0 < len(rest) < len(free):
        found["com_y = 0"] = calibrate(target, base.with_values({"com_y": 0.0}), rest)
    theory: TurnTable | SteadyRows
    if isinstance(target, TurnTable):
        theory = replace(target, theory=True)
        lowest = calibrate(replace(theory, radius_scale=np.inf), best.candidate, free)
    else:
        assert isinstance(target, SteadyRows)
        theory = replace(target, theory=True)
        lowest = calibrate(theory, best.candidate, free)
    metrics = theory.metrics(theory.errors(lowest.candidate))
    return found | {
        "theory, slips alone" if isinstance(target, TurnTable) else "theory": replace(lowest, metrics=metrics)
    }


def tested(config: Config, base: Candidate, best: Calibration) -> tuple[dict[str, float], dict[str, float], float]:
    """Errors on the log `config.test` of the base and of the best candidate, each with its own clock if it is free.

    The third is the clock of the best candidate there [s].
    """
    target = read_target(str(config.test), config, base)
    clock = best.estimates.get("clock")
    errors, clocks = list[dict[str, float]](), list[float]()
    for one in (base, best.candidate):
        fitted = calibrate(target, one, ("clock",)).candidate if clock and isinstance(target, Drives) else one
        errors.append(target.metrics(target.errors(fitted)))
        clocks.append(fitted.clock)
    return errors[0], errors[1], clocks[-1]


def summary_of(
    best: Calibration,
    others: Mapping[str, Calibration],
    test: tuple[dict[str, float], dict[str, float], float] | None,
) -> dict[str, Any]:
    """A calibration as a summary."""
    place = best.candidate.sensor
    found = fit_summary(best) | {
        "sensor": {"x": place.x, "y": place.y, "yaw": place.yaw, "clock_offset": best.candidate.clock},
        "before": best.before,
        "variants": {title: fit_summary(fit) for title, fit in others.items()},
        "starts": [{"cost": cost, "values": {n: end.value(n) for n in best.estimates}} for end, cost in best.ends],
    }
    if best.held_out is not None:
        found["held_out"] = {"before": best.held_out_before, "calibrated": best.held_out}
    if test:
        found["test"] = {"before": test[0], "calibrated": test[1], "clock_offset": test[2]}
    return found


def fit_summary(fit: Calibration) -> dict[str, Any]:
    """A fit as an entry of a summary: parameters, their errors, what is left, and the values of the folds."""
    parameters = {name: {**vars(one), "identifiable": not one.held} for name, one in fit.estimates.items()}
    folds = [{name: fold.value(name) for name in fit.estimates} for fold in fit.folds]
    return {"parameters": parameters, "correlation": fit.correlation, **fit.metrics} | (
        {"folds": folds} if folds else {}
    )


def printed(name: str, unit: str) -> tuple[float, str]:
    """Factor from SI and unit in which a parameter is printed."""
    return (1e2, "%") if name.startswith("radius") else printed_unit(unit)


def parameter_cells(name: str, one: Estimate | None) -> tuple[str, str]:
    """A parameter with its standard error, and its interval."""
    if one is None:
        return MISSING, MISSING
    unit = printed(name, one.unit)
    if one.held:
        return f"{unit[0] * one.value:.4g} {unit[1]} (held)".replace("  ", " "), MISSING
    cells = with_error(one.value, one.stderr, unit, (one.low, one.high))
    return cells[0], cells[1]


def parameter_table(title: str, fit: Calibration, others: Mapping[str, Calibration] = {}) -> Table:
    """Parameters of a fit, and of those that it is compared with."""
    rows = [
        (
            name,
            *parameter_cells(name, one),
            *(parameter_cells(name, other.estimates.get(name))[0] for other in others.values()),
        )
        for name, one in fit.estimates.items()
    ]
    return Table(title, ("parameter", "fit", "95 %", *others), rows)


def print_fits(
    title: str,
    best: Calibration,
    others: Mapping[str, Calibration],
    test: tuple[dict[str, float], dict[str, float], float] | None,
) -> None:
    """Print parameters and errors of a fit, and of those that it is compared with."""
    rows = [
        (
            name,
            *parameter_cells(name, one),
            *(parameter_cells(name, fit.estimates.get(name))[0] for fit in others.values()),
        )
        for name, one in best.estimates.items()
    ]
    if others:
        rows += [
            (label, value, "", *others_of)
            for label, value, *others_of in _metric_rows([best.metrics, *(fit.metrics for fit in others.values())])
        ]
    Table(title, ("parameter", "fit", "95 %", *others), rows).print()
    for name, one in best.estimates.items():
        if one.held:
            print(f"{name} is held: {one.held}")
    columns = {"before": best.before, "calibrated": best.metrics}
    if best.held_out is not None and best.held_out_before is not None:
        columns |= {"held out, before": best.held_out_before, "held out": best.held_out}
    if test:
        columns |= {"test, before": test[0], "test": test[1]}
    if not others or len(columns) > 2:
        Table("Simulated minus measured", ("error", *columns), _metric_rows(list(columns.values()))).print()
    if test and test[2] != best.candidate.clock:
        print(f"the test log is predicted with --clock-offset={test[2]:.3g}")
    if len(best.ends) > 1:
        known = {name: one.stderr for name, one in best.estimates.items() if not one.held}
        ends = [[end.value(name) for name in known] for end, _ in best.ends]
        apart = np.abs(np.subtract(ends, ends[0])) / list(known.values())
        number_of = counted(len(ends), "start")
        print(f"{number_of} end within {apart.max(initial=0.0):.1g} standard errors of each other")


def _metric_rows(metrics: list[dict[str, float]]) -> list[tuple[str, ...]]:
    """Rows of a table of errors, which are its columns."""
    rows = []
    for name in metrics[0]:
        kind, _, rest = name.partition("_")
        label, factor, digits, unit = _METRICS[kind]
        ahead, _, statistic = rest.partition("_")
        if statistic:
            if statistic not in _STATISTICS:
                continue
            label = f"{label} after {ahead.removesuffix('s')} s, {_STATISTICS[statistic]}"
        values = (None if name not in one else factor * one[name] for one in metrics)
        rows.append((label, *(number(value, digits, unit) for value in values)))
    return rows
