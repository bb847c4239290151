"""`trackslip identify`: slip laws from a stored grid or from a real robot's log."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from experiments.options.identify import IdentifyConfig
from experiments.report.terminal import print_table
from experiments.storage.manifest import command_line, make_manifest
from experiments.storage.plain_json import plain, write_json
from experiments.storage.results import (
    MANIFEST_FILE,
    REPORT_FILE,
    SUMMARY_FILE,
    results_folder,
    write_runs,
    write_samples,
)
from experiments.sweep.choose import chosen, require_one_setting
from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.comparison import Comparison
from trackslip.identification.identify import identify
from trackslip.identification.samples import Sampling, usable_rows, usable_samples
from trackslip.kinematics import RobotGeometry
from trackslip.logs.logfile import REQUIRED, SAMPLE_COLUMNS, read_samples, read_table, runs_file, runs_from_table
from trackslip.logs.runlog import RunLog
from trackslip.slip.families import FAMILIES
from trackslip.slip.law_file import identification_to_json


@dataclass(frozen=True)
class Source:
    """What was read: samples, and the runs they come from, if there are any."""

    geometry: RobotGeometry
    sampling: Sampling
    logs: Sequence[RunLog]

    @property
    def origin(self) -> dict[str, Any]:
        """Seed, model and ground that all runs agree on; empty for a real robot's."""
        metadata = [log.metadata for log in self.logs]
        return {
            key: metadata[0][key]
            for key in ("seed", "model_sha256", "ground")
            if metadata and all(one.get(key) == metadata[0].get(key) is not None for one in metadata)
        }


def run(config: IdentifyConfig) -> None:
    """Fit the laws, store and print them."""
    from experiments.report.reproduction import (  # late: others read logs with this module, and draw nothing
        Report,
        render,
    )

    began = time.perf_counter()
    with results_folder(config.out) as folder:
        source = read_source(config)
        found = identify(source.sampling, source.geometry)
        summary = identification_to_json(found, source.geometry)
        wall = time.perf_counter() - began
        summary["timing"] = {"wall_s": wall, "stages": {"identify": wall}}
        about = make_manifest("identify", config, wall, **source.origin)
        if source.logs:
            write_runs(folder, source.logs)
        else:
            write_samples(folder, source.sampling.samples)
        write_json(folder / SUMMARY_FILE, summary)
        write_json(folder / MANIFEST_FILE, about)
        page = Report(
            title=f"Slip laws identified from {config.path.name}",
            command=command_line("identify"),
            manifest=about,
            summary=plain(summary),
            comparison=(),
            grid_logs=source.logs,
            identification=found,
        )
        render(page).write(folder, config.pdf)
    runs = len(found.samples)
    print_table(f"Slip laws from {runs} runs", LAW_HEADER, law_rows(found.comparison))
    print_table("Laws compared, the best first", COMPARISON_HEADER, comparison_rows(found.comparison))
    for warning in found.warnings:
        print(f"warning: {warning}")
    print(f"best: {found.comparison.best}, {FAMILIES[found.comparison.best].title}")
    print(f"{config.out / REPORT_FILE}: {time.perf_counter() - began:.1f} s")


def read_source(config: IdentifyConfig) -> Source:
    """Samples from a stored folder or a log; raises LogError or InvalidValueError for what can't be used."""
    file = runs_file(config.path)
    try:
        return _read(config, file)
    except LogError as error:
        raise error if str(file) in str(error) else LogError(f"{file}: {error}") from error


def _read(config: IdentifyConfig, file: Path) -> Source:
    table = read_table(file)
    columns = table.column_names
    if "x" not in columns and set(SAMPLE_COLUMNS) <= set(columns):
        if config.where:
            raise InvalidValueError("where", " ".join(config.where), "left out: steady samples aren't a sweep's runs")
        geometry = choose_geometry(config, None, file)
        omega, twist = read_samples(table, str(file))
        return Source(geometry, usable_rows(omega / config.gear, twist, geometry), ())
    if not set(columns) & set(REQUIRED[1:]):
        needed = f"{', '.join(REQUIRED)} or {', '.join(SAMPLE_COLUMNS)}"
        raise LogError(f"{file}: needs the columns {needed}; found {', '.join(columns)[:200]!r}")
    runs = runs_from_table(table, str(file))
    logs = [log for log in runs if "controller" not in log.metadata]
    if config.where:
        names = chosen(file.parent, config.where)
        logs = [log for log in logs if log.run in names]
        if not logs:
            raise LogError(f"{file}: none of the {len(names)} run(s) chosen with --where is there: they failed")
    if not logs:
        raise LogError(f"{file}: its {len(runs)} run(s) are closed loops; slip is identified from steady runs")
    require_one_setting(logs, file)
    geometry = choose_geometry(config, logs[0].metadata.get("geometry"), file)
    known = {"geometry": plain(geometry)}
    logs = [replace(log, omega=log.omega / config.gear, metadata=log.metadata | known) for log in logs]
    return Source(geometry, usable_samples(logs, geometry, config.settle, config.motion), logs)


def choose_geometry(config: IdentifyConfig, stored: Any, file: Path) -> RobotGeometry:
    """The geometry on the command line, else the log's."""
    values = {}
    for name in ("half_gauge", "sprocket_radius"):
        given = getattr(config, name)
        value = stored.get(name) if given is None and isinstance(stored, dict) else given
        if not isinstance(value, int | float):
            raise InvalidValueError(name, value, f"given with --{name.replace('_', '-')}: {file} doesn't say it")
        values[name] = float(value)
    return RobotGeometry(**values)


LAW_HEADER = ("law", "parameter", "value", "std. error", "95 % interval", "by bootstrap")
COMPARISON_HEADER = ("law", "free", "rms", "AICc", "weight", "cv radius", "cv speed", "cv yaw rate", "lack of fit")
SYMBOLS = {
    "alpha_outer": "alpha outer",
    "beta_outer": "beta outer",
    "alpha_inner": "alpha inner",
    "beta_inner": "beta inner",
    "gamma_outer": "gamma outer",
    "gamma_inner": "gamma inner",
    "slip_outer": "slip outer",
    "slip_inner": "slip inner",
    "size": "a",
    "pole": "p",
    "offset": "D",
    "radius_error": "epsilon",
    "offset_left": "D left",
    "offset_right": "D right",
    "radius_error_left": "epsilon left",
    "radius_error_right": "epsilon right",
}


def law_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """A row a parameter."""
    rows: list[tuple[str, ...]] = []
    for name, fit in comparison.laws.items():
        for k, (parameter, value) in enumerate(fit.values.items()):
            ends = [fit.interval95[parameter], fit.bootstrap95.get(parameter)]
            symbol = f"{SYMBOLS[parameter]} [{FAMILIES[name].parameters[parameter].unit or '-'}]"
            intervals = ["-" if pair is None else f"{pair[0]:+.5f} .. {pair[1]:+.5f}" for pair in ends]
            rows.append((name if k == 0 else "", symbol, f"{value:+.5f}", f"{fit.stderr[parameter]:.5f}", *intervals))
    return rows


def comparison_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """A row a law, by AICc."""
    rows: list[tuple[str, ...]] = []
    least = min((value for value in comparison.aicc.values() if value is not None), default=0.0)
    for name in comparison.ranking:
        fit, aicc, validation = comparison.laws[name], comparison.aicc[name], comparison.validation[name]
        lack = fit.lack_of_fit
        rows.append(
            (
                name,
                str(len(fit.values)),
                f"{fit.rms:.5f}",
                "-" if aicc is None else f"+{aicc - least:.1f}",
                _or_dash(comparison.weight[name], ".2f"),
                _or_dash(validation.radius, ".5f"),
                _or_dash(validation.speed, ".5f"),
                _or_dash(validation.yaw_rate, ".5f"),
                "-" if lack is None else f"p = {lack.probability:.2g}" + ("" if lack.significant else ", none"),
            )
        )
    return rows


def _or_dash(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)
