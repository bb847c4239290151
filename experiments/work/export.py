"""`trackslip export`: stored runs as CSV, for spreadsheets and for programs without Parquet."""

import csv
import os
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from experiments.options.export import ExportConfig
from experiments.report.terminal import print_table
from trackslip.errors import InvalidValueError, OutputError
from trackslip.logs.logfile import write_csv
from trackslip.logs.runlog import RunLog
from trackslip.logs.schema import COLUMNS
from trackslip.logs.table import to_table
from trackslip.ros.any_log import read_runs_of

_SHOWN = 10  # names in a message


def run(config: ExportConfig) -> None:
    """List the runs, or write them."""
    read = read_runs_of(config.path)
    for line in read.warnings:
        print(f"warning: {line}")
    logs = [replace(log, scans=None) for log in chosen(read.runs, config.run or ())]
    if not config.csv:
        print_table(f"Runs in {config.path}", ("run", "rows", "duration [s]", "truth"), [_row(log) for log in logs])
        return
    file, about = config.file, config.file.with_suffix(".columns.csv")
    if file.exists() and file.samefile(config.path):
        raise InvalidValueError("out", str(file), "a file other than the one being read")
    for name in (file, about):
        if name.exists() and not config.overwrite:
            raise OutputError(f"{name}: exists already; --overwrite replaces it")
    _write(logs, file, about)
    print(f"{file}: {len(logs)} run(s), {sum(len(log.time) for log in logs)} rows; units in {about.name}")
    geometry = logs[0].metadata.get("geometry")
    steady = any(log.twist_command is None for log in logs)  # runs under a controller aren't
    if isinstance(geometry, dict) and steady:
        options = " ".join(f"--{name.replace('_', '-')} {value:g}" for name, value in geometry.items())
        print(f"trackslip identify {file} {options}")


def chosen(logs: Sequence[RunLog], names: Sequence[str]) -> list[RunLog]:
    """The runs with these names, in that order, or all runs; raises InvalidValueError for an unknown name."""
    known = {log.run: log for log in logs}
    for name in names:
        if name not in known:
            more = f", ... ({len(known)} of them)" if len(known) > _SHOWN else ""
            raise InvalidValueError("run", name, f"one of {', '.join(map(repr, list(known)[:_SHOWN]))}{more}")
    return [known[name] for name in names] or list(logs)


def _row(log: RunLog) -> tuple[str, ...]:
    return log.run, str(len(log.time)), f"{log.time[-1] - log.time[0]:.2f}", "no" if log.truth is None else "yes"


def _write(logs: Sequence[RunLog], file: Path, about: Path) -> None:
    """Write the runs, and unit and meaning of each column: both files complete, or none."""
    columns = [COLUMNS[name] for name in to_table(logs).column_names]
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".partial-", dir=file.parent) as folder:
            with (Path(folder) / about.name).open("w", newline="", encoding="utf-8") as text:
                writer = csv.writer(text)
                writer.writerow(("column", "unit", "description"))
                writer.writerows((column.name, column.unit, column.description) for column in columns)
            write_csv(logs, Path(folder) / file.name)
            for path in (about, file):
                os.replace(Path(folder) / path.name, path)
    except OSError as error:
        raise OutputError(f"{file}: can't be written ({error.strerror or error})") from error
