"""`trackslip calibrate`: tune the simulated robot to published or measured slips and radii."""

import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.driving.grid_runs import sample_runs
from experiments.options.calibrate import CalibrateConfig
from experiments.recording import record_all
from experiments.report.terminal import busy, print_table, progress
from experiments.storage.manifest import command_line, make_manifest
from experiments.storage.results import results_folder, write_results
from sim.calibration.calibration import Candidate, Fit, calibrate, floor, simulated_twist, starts
from sim.calibration.target import MeasuredTurns, Target, TurnTable
from sim.ground.ground import Ground
from sim.robot.file import load_robot_file, robot_file_text
from sim.seeds import generator
from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.source import Reading, read_source
from trackslip.kinematics import RobotGeometry
from trackslip.logs.logfile import read_table
from trackslip.logs.table import read_columns

ROBOT = "robot.toml"
TABLE_COLUMNS = ("radius", "speed", "observed_radius", "slip_outer", "slip_inner")


def run(config: CalibrateConfig) -> None:
    """Fit, store and print."""
    began = time.perf_counter()
    with results_folder(config.out) as folder:
        robot, ground = load_robot_file(config.robot)
        base = Candidate(robot, ground.across / ground.along, ground.shear)
        target = read_target(config.target, base.geometry)
        twist = partial(simulated_twist, along=ground.along, threads=config.threads)
        further = starts(config.free, config.starts, generator(config.seed, "calibrate"))
        with progress(f"calibration to {config.target}", 3 + config.starts, "fits") as report:
            best = calibrate(base, config.free, target, twist, further, report)
            centred = centred_fit(base, config.free, target, twist)
            report(1)
            lowest = floor(best, target)
            report(1)
        wall = time.perf_counter() - began
        summary = fit_summary(best) | {
            "floor": {"slip_rms": lowest.slip_rms, "values": values(lowest, lowest.candidate)},
            "centred": None if centred is None else fit_summary(centred),
            "starts": [{"cost": cost, "values": values(best, end)} for end, cost in best.ends],
            "wall_s": wall,
            "timing": {"wall_s": wall},
        }
        made = Ground(ground.along, ground.along * best.candidate.friction_ratio, shear=best.candidate.shear)
        comment = f"made by: {command_line('calibrate')}"
        (folder / ROBOT).write_text(robot_file_text(best.candidate.robot, made, comment), encoding="utf-8")
        write_results(folder, summary, make_manifest("calibrate", config, wall, seed=config.seed))
        if config.rrd:
            with busy("recordings"):
                record_all(folder, sample_runs(folder / ROBOT, config))
    _print(config, best, centred, lowest, wall)


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
        source = read_source(path, Reading(geometry.half_gauge, geometry.sprocket_radius))
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


def centred_fit(base: Candidate, free: Sequence[str], target: Target, twist: Any) -> Fit | None:
    """The fit with the centre of mass midway between the tracks; None unless com_y and something else are free."""
    rest = [name for name in free if name != "com_y"]
    if not rest or len(rest) == len(free):
        return None
    return calibrate(base.with_values({"com_y": 0.0}), rest, target, twist, np.empty((0, len(rest))))


def values(fit: Fit, candidate: Candidate) -> dict[str, float]:
    """A candidate's values of the parameters that were free in a fit [SI]."""
    return {name: candidate.value(name) for name in fit.free}


def fit_summary(fit: Fit) -> dict[str, Any]:
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


def _value(fit: Fit, name: str) -> str:
    if name not in fit.free:
        return "-"
    factor, unit = (1.0, "") if name in ("friction_ratio", "radius_error") else (1e3, " mm")
    value = factor * fit.candidate.value(name)
    if name not in fit.stderr:
        return f"{value:.4g}{unit} (open)"
    error = factor * fit.stderr[name]
    digits = max(0, 1 - int(np.floor(np.log10(error))))
    return f"{value:.{digits}f} ± {error:.{digits}f}{unit}"


def _print(config: CalibrateConfig, best: Fit, centred: Fit | None, lowest: Fit, wall: float) -> None:
    columns = {"fit": best} | ({} if centred is None else {"com_y = 0": centred}) | {"theory, slips alone": lowest}
    rows = [(name, *(_value(fit, name) for fit in columns.values())) for name in config.free]
    rows.append(("slip, rms", *(f"{fit.slip_rms:.4f}" for fit in columns.values())))
    if best.radius_rms is not None:
        rows.append(("radius, rms", *(f"{fit.radius_rms:.2%}" for fit in columns.values())))
    print_table(f"Calibrated to {config.target}", ("parameter", *columns), rows)
    for name, others in best.correlation.items():
        if name == "shear" and others:
            print("correlation of shear with", ", ".join(f"{other} {value:+.2f}" for other, value in others.items()))
    if best.tied:
        print(f"not identifiable separately: {', '.join(best.tied)}; the target leaves their values open")
    if len(best.ends) > 1:
        ends = [[end.value(name) for name in best.stderr] for end, _ in best.ends]
        apart = np.abs(np.subtract(ends, ends[0])) / list(best.stderr.values())
        print(f"{len(ends)} starts end within {apart.max(initial=0.0):.1g} standard errors of each other")
    print(f"{config.out / ROBOT}: {wall:.1f} s; use it with --robot {config.out / ROBOT}")
