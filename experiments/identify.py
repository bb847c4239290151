"""`trackslip identify`: slip laws from a stored grid or from a real robot's log."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from experiments import store
from experiments.config import IdentifyConfig
from experiments.console import print_table
from experiments.report import Report, render
from trackslip.errors import InvalidValueError, LogError
from trackslip.identification import FittedLaw, SlipSamples, fit_laws, slip_samples
from trackslip.kinematics import RobotGeometry
from trackslip.lawfile import laws_to_json
from trackslip.logfile import REQUIRED, SAMPLE_COLUMNS, read_samples, read_table, runs_from_table
from trackslip.runlog import RunLog


@dataclass(frozen=True)
class Source:
    """What was read: samples, and the runs they come from, if there are any."""

    geometry: RobotGeometry
    samples: SlipSamples
    logs: Sequence[RunLog]

    @property
    def origin(self) -> dict[str, Any]:
        """Seed and model of simulated runs; empty for a real robot's."""
        metadata = self.logs[0].metadata if self.logs else {}
        return {key: metadata[key] for key in ("seed", "model_sha256") if key in metadata}


def run(config: IdentifyConfig) -> None:
    """Fit the laws, store and print them."""
    began = time.perf_counter()
    source = read_source(config)
    with store.results(config.out) as folder:
        laws, warnings = fit_laws(source.samples, source.geometry)
        summary = laws_to_json(laws, source.geometry) | {"samples": len(source.samples.run), "warnings": warnings}
        wall = time.perf_counter() - began
        summary["timing"] = {"wall_s": wall, "stages": {"identify": wall}}
        about = store.manifest("identify", config, wall, **source.origin)
        if source.logs:
            store.write_parquet(folder, source.logs)
        else:
            store.write_samples(folder, source.samples)
        store.write_json(folder / store.SUMMARY, summary)
        store.write_json(folder / store.MANIFEST, about)
        page = Report(
            title=f"Slip laws identified from {config.path.name}",
            command=store.command_line("identify"),
            manifest=about,
            summary=store.plain(summary),
            comparison=(),
            grid_logs=source.logs,
            samples=source.samples,
            laws=laws,
        )
        (folder / store.REPORT).write_text(render(page), encoding="utf-8")
    print_table(f"Slip laws from {len(source.samples.run)} runs", LAW_HEADER, law_rows(laws))
    for warning in warnings:
        print(f"warning: {warning}")
    print(f"{config.out / store.REPORT}: {time.perf_counter() - began:.1f} s")


def read_source(config: IdentifyConfig) -> Source:
    """Samples from a stored folder or a log; raises LogError or InvalidValueError for what can't be used."""
    try:
        file = config.path / store.RUNS if config.path.is_dir() else config.path
    except OSError as error:
        raise LogError(f"path = {str(config.path)[:80]!r}: {error.strerror}") from error
    try:
        return _read(config, file)
    except LogError as error:
        raise error if str(file) in str(error) else LogError(f"{file}: {error}") from error


def _read(config: IdentifyConfig, file: Path) -> Source:
    table = read_table(file)
    columns = table.column_names
    if "x" not in columns and set(SAMPLE_COLUMNS) <= set(columns):
        geometry = choose_geometry(config, None, file)
        omega, twist = read_samples(table, str(file))
        names = [f"row {k + 1}" for k in range(len(omega))]
        return Source(geometry, SlipSamples.of(omega, twist, geometry, names), ())
    if not set(columns) & set(REQUIRED[1:]):
        needed = f"{', '.join(REQUIRED)} or {', '.join(SAMPLE_COLUMNS)}"
        raise LogError(f"{file}: needs the columns {needed}; found {', '.join(columns)[:200]!r}")
    runs = runs_from_table(table, str(file))
    logs = [log for log in runs if "controller" not in log.metadata]
    if not logs:
        raise LogError(f"{file}: its {len(runs)} run(s) are closed loops; slip is identified from steady runs")
    geometry = choose_geometry(config, logs[0].metadata.get("geometry"), file)
    known = {"geometry": store.plain(geometry)}
    logs = [replace(log, metadata=log.metadata | known) for log in logs]
    return Source(geometry, slip_samples(logs, geometry, config.settle, config.motion), logs)


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


LAW_HEADER = ("law", "parameter", "value", "std. error", "rms residual")
_SYMBOLS = {
    "alpha_outer": "alpha outer [-]",
    "beta_outer": "beta outer [1/m]",
    "alpha_inner": "alpha inner [-]",
    "beta_inner": "beta inner [1/m]",
    "offset": "D [m]",
    "radius_error": "epsilon [-]",
}


def law_rows(laws: Mapping[str, FittedLaw]) -> list[tuple[str, ...]]:
    """A row a parameter."""
    rows: list[tuple[str, ...]] = []
    for name, fit in laws.items():
        for k, (parameter, value) in enumerate(fit.values.items()):
            head, tail = (name, f"{fit.rms:.5f}") if k == 0 else ("", "")
            rows.append((head, _SYMBOLS[parameter], f"{value:+.5f}", f"{fit.stderr[parameter]:.5f}", tail))
    return rows
