"""Calibration of the simulated robot: its targets, and its fits as results and as a table."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.report.table import Table
from sim.calibration.calibration import Calibration, Candidate, calibrate
from sim.calibration.target import MeasuredTurns, Target, TurnTable
from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.source import ReadOptions, read_source
from trackslip.kinematics import RobotGeometry
from trackslip.logs.logfile import read_table
from trackslip.logs.table import read_columns

TABLE_COLUMNS = ("radius", "speed", "observed_radius", "slip_outer", "slip_inner")


def read_target(name: str, geometry: RobotGeometry) -> Target:
    """The published target, or that in a file, `geometry` being used for a log without; raises LogError."""
    if name == "published":
        return TurnTable.published()
    path = Path(name)
    if path.suffix.lower() in (".csv", ".parquet"):
        table = read_table(path)
        if set(TABLE_COLUMNS) & set(table.column_names):
            return _turn_table(read_columns(table, TABLE_COLUMNS, name), name)
    try:
        source = read_source(path)
    except InvalidValueError:  # the log contains no geometry
        source = read_source(path, ReadOptions(geometry.half_gauge, geometry.sprocket_radius))
    simulated = bool(source.logs) and all("plate" in log.metadata for log in source.logs)
    return MeasuredTurns(source.sampling.samples, source.geometry, of_plate=simulated)


def _turn_table(columns: Any, name: str) -> TurnTable:
    for label, column in zip(TABLE_COLUMNS, columns.T, strict=True):
        wrong, allowed = (column >= 1, "< 1") if label.startswith("slip") else (column <= 0, "> 0")
        if np.any(wrong):
            row = int(np.argmax(wrong))
            raise LogError(f"{name}: row {row + 1}, column {label}: {column[row]:g} must be {allowed}")
    radius, speed, observed, outer, inner = columns.T
    return TurnTable(radius, speed, observed, np.stack([inner, outer], axis=-1), 3 * len(columns))


def centred_fit(base: Candidate, free: Sequence[str], target: Target, twist: Any) -> Calibration | None:
    """The fit with the centre of mass midway between the tracks; None unless com_y and something else are free."""
    rest = [name for name in free if name != "com_y"]
    if not rest or len(rest) == len(free):
        return None
    return calibrate(base.with_values({"com_y": 0.0}), rest, target, twist, np.empty((0, len(rest))))


def values(fit: Calibration, candidate: Candidate) -> dict[str, float]:
    """A candidate's values of the parameters that were free in a fit [SI]."""
    return {name: candidate.value(name) for name in fit.free}


def fit_summary(fit: Calibration) -> dict[str, Any]:
    """A fit as an entry of the summary; a parameter that the target does not determine has no standard error."""
    parameters = {
        name: {"value": value, "stderr": fit.stderr.get(name), "identifiable": name not in fit.tied}
        for name, value in values(fit, fit.candidate).items()
    }
    return {
        "parameters": parameters,
        "correlation": fit.correlation,
        "slip_rms": fit.slip_rms,
        "radius_rms": fit.radius_rms,
    }


def _value(fit: Calibration, name: str) -> str:
    if name not in fit.free:
        return "-"
    factor, unit = (1.0, "") if name in ("friction_ratio", "radius_error") else (1e3, " mm")
    value = factor * fit.candidate.value(name)
    if name not in fit.stderr:
        return f"{value:.4g}{unit} (open)"
    error = factor * fit.stderr[name]
    digits = max(0, 1 - int(np.floor(np.log10(error))))
    return f"{value:.{digits}f} ± {error:.{digits}f}{unit}"


def print_fits(title: str, best: Calibration, centred: Calibration | None, lowest: Calibration) -> None:
    """Print the parameters and misfits of the fit, of that with a centred mass, and of theory alone."""
    columns = {"fit": best} | ({} if centred is None else {"com_y = 0": centred}) | {"theory, slips alone": lowest}
    rows = [(name, *(_value(fit, name) for fit in columns.values())) for name in best.free]
    rows.append(("slip, rms", *(f"{fit.slip_rms:.4f}" for fit in columns.values())))
    if best.radius_rms is not None:
        rows.append(("radius, rms", *(f"{fit.radius_rms:.2%}" for fit in columns.values())))
    Table(title, ("parameter", *columns), rows).print()
    for name, others in best.correlation.items():
        if name == "shear" and others:
            print("correlation of shear with", ", ".join(f"{other} {value:+.2f}" for other, value in others.items()))
    if best.tied:
        print(f"not identifiable separately: {', '.join(best.tied)}; the target leaves their values open")
    if len(best.ends) > 1:
        ends = [[end.value(name) for name in best.stderr] for end, _ in best.ends]
        apart = np.abs(np.subtract(ends, ends[0])) / list(best.stderr.values())
        print(f"{len(ends)} starts end within {apart.max(initial=0.0):.1g} standard errors of each other")
