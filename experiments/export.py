"""Stored runs as CSV: the choice of runs, their list, and the columns' units and meanings."""

import csv
from collections.abc import Sequence
from pathlib import Path

from experiments.report.table import Table
from trackslip.errors import InvalidValueError
from trackslip.logs.runlog import RunLog
from trackslip.logs.schema import COLUMNS
from trackslip.logs.table import to_table

_SHOWN = 10  # names in a message


def chosen(logs: Sequence[RunLog], names: Sequence[str]) -> list[RunLog]:
    """The runs with these names, in that order, or all runs; raises InvalidValueError for an unknown name."""
    known = {log.run: log for log in logs}
    for name in names:
        if name not in known:
            more = f", ... ({len(known)} of them)" if len(known) > _SHOWN else ""
            raise InvalidValueError("run", name, f"one of {', '.join(map(repr, list(known)[:_SHOWN]))}{more}")
    return [known[name] for name in names] or list(logs)


def runs_table(path: Path, logs: Sequence[RunLog]) -> Table:
    """The runs, how long they are, and whether the truth is known."""
    rows = [
        (log.run, str(len(log.time)), f"{log.time[-1] - log.time[0]:.2f}", "no" if log.truth is None else "yes")
        for log in logs
    ]
    return Table(f"Runs in {path}", ("run", "rows", "duration [s]", "truth"), rows)


def write_columns(logs: Sequence[RunLog], file: Path) -> None:
    """Write unit and meaning of each column of the runs to a CSV file."""
    with file.open("w", newline="", encoding="utf-8") as text:
        writer = csv.writer(text)
        writer.writerow(("column", "unit", "description"))
        columns = (COLUMNS[name] for name in to_table(logs).column_names)
        writer.writerows((column.name, column.unit, column.description) for column in columns)


def identify_options(logs: Sequence[RunLog]) -> str:
    """The robot's geometry as options of identify; empty if it is unknown, or the runs were under a controller."""
    geometry = logs[0].metadata.get("geometry")
    if not isinstance(geometry, dict) or all(log.twist_command is not None for log in logs):
        return ""
    return " ".join(f"--{name.replace('_', '-')} {value:g}" for name, value in geometry.items())
