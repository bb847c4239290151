"""`trackslip identify`: slip laws from a stored grid or from a real robot's log."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from experiments.options.identify import IdentifyConfig
from experiments.report.formats import for_terminal
from experiments.report.terminal import print_table, progress
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
from trackslip.identification.identify import identify
from trackslip.identification.samples import Sampling, usable_rows, usable_samples
from trackslip.kinematics import RobotGeometry
from trackslip.logs.logfile import REQUIRED, SAMPLE_COLUMNS, read_samples, read_table, runs_file, runs_from_table
from trackslip.logs.runlog import RunLog
from trackslip.slip.families import FAMILIES
from trackslip.slip.law_file import identification_to_json


@dataclass(frozen=True)
class Source:
    """Samples, and the runs they come from, if there are any."""

    geometry: RobotGeometry
    sampling: Sampling
    logs: Sequence[RunLog]

    @property
    def origin(self) -> dict[str, Any]:
        """Seed, model and ground that all runs share; empty for a real robot's log."""
        metadata = [log.metadata for log in self.logs]
        return {
            key: metadata[0][key]
            for key in ("seed", "model_sha256", "ground")
            if metadata and all(one.get(key) == metadata[0].get(key) is not None for one in metadata)
        }


def run(config: IdentifyConfig) -> None:
    """Fit the laws, store and print them."""
    # late: calibrate reads logs with this module and draws nothing
    from experiments.report.identification import (
        CRITERIA_HEADER,
        LAW_HEADER,
        criteria_rows,
        criteria_table,
        law_rows,
        law_table,
    )
    from experiments.report.reproduction import Report, render

    began = time.perf_counter()
    with results_folder(config.out) as folder, progress("identification", 3, "steps") as report:
        source = read_source(config)
        report(1)
        found = identify(source.sampling, source.geometry)
        report(1)
        wall = time.perf_counter() - began
        timing = {"wall_s": wall, "stages": {"identify": wall}}
        manifest = make_manifest("identify", config, wall, **source.origin)
        if source.logs:
            write_runs(folder, source.logs)
        else:
            write_samples(folder, source.sampling.samples)
        write_json(folder / SUMMARY_FILE, identification_to_json(found, source.geometry) | {"timing": timing})
        write_json(folder / MANIFEST_FILE, manifest)
        page = Report(
            title=f"Slip laws identified from {config.path.name}",
            command=command_line("identify"),
            manifest=manifest,
            grid_logs=source.logs,
            identification=found,
        )
        render(page).write(folder, config.pdf)
        report(1)
    best = found.comparison.best
    laws, criteria = law_table(law_rows(found.comparison)), criteria_table(criteria_rows(found))
    print_table(f"Slip laws from {len(found.samples)} runs", LAW_HEADER, for_terminal(laws))
    print_table("Laws compared, the best first", CRITERIA_HEADER, for_terminal(criteria))
    for warning in found.warnings:
        print(f"warning: {warning}")
    print(f"best: {best}, {FAMILIES[best].title}")
    print(f"{config.out / REPORT_FILE}: {time.perf_counter() - began:.1f} s")


def read_source(config: IdentifyConfig) -> Source:
    """Read samples from a folder of results or a log; raises LogError or InvalidValueError if they cannot be used."""
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
            raise InvalidValueError(
                "where", " ".join(config.where), "left out: steady samples are not the runs of a sweep"
            )
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
            raise LogError(f"{file}: none of the {len(names)} run(s) chosen with --where is stored: they failed")
    if not logs:
        raise LogError(f"{file}: its {len(runs)} run(s) are closed loops, and slip is identified from steady runs")
    require_one_setting(logs, file)
    geometry = choose_geometry(config, logs[0].metadata.get("geometry"), file)
    known = {"geometry": plain(geometry)}
    logs = [replace(log, omega=log.omega / config.gear, metadata=log.metadata | known) for log in logs]
    return Source(geometry, usable_samples(logs, geometry, config.settle, config.motion), logs)


def choose_geometry(config: IdentifyConfig, stored: Any, file: Path) -> RobotGeometry:
    """The geometry from the command line, else from the log."""
    values = {}
    for name in ("half_gauge", "sprocket_radius"):
        given = getattr(config, name)
        value = stored.get(name) if given is None and isinstance(stored, dict) else given
        if not isinstance(value, int | float):
            raise InvalidValueError(
                name, value, f"given with --{name.replace('_', '-')}, because {file} does not contain it"
            )
        values[name] = float(value)
    return RobotGeometry(**values)
