"""`trackslip export`: stored runs as CSV, for spreadsheets and for programs without Parquet."""

import csv
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import tyro

from experiments.common.options import Distinct, Exclusion, Needs, Options, default_is
from trackslip.errors import InvalidValueError, counted

if TYPE_CHECKING:
    from trackslip.logs.runlog import RunLog

_SHOWN = 10  # names in a message
EXAMPLES = (
    ("list the runs", "trackslip export out/grid"),
    ("write all runs as CSV", "trackslip export out/grid --csv"),
    ("write one run", 'trackslip export out/grid --csv --run "radius=0.5 speed=0.1" --out run.csv'),
)


@dataclass(frozen=True)
class Config(Options):
    """List the runs in a folder of results or, with --csv, write them as CSV for spreadsheets and for identify."""

    path: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUNS")]
    """Folder of results with runs.parquet, or a .parquet or .csv file of runs."""
    csv: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Write a CSV file, and NAME.columns.csv with the unit and meaning of each column."""
    run: Annotated[tuple[str, ...] | None, Distinct(), default_is("all", "NAME ...")] = None
    """Names of the runs to list or write."""
    out: Annotated[Path | None, default_is("the name of RUNS with the suffix .csv, beside it", "FILE")] = None
    """The CSV file to write; needs --csv."""
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Replace the CSV file if it exists; needs --csv."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (Needs(("out", "overwrite"), "csv"),)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.out is not None and self.out.suffix.lower() != ".csv":
            raise InvalidValueError("out", str(self.out), "a file that ends in .csv")

    @property
    def file(self) -> Path:
        """The CSV file."""
        whole = self.path.resolve()
        beside = self.path.parent / f"{whole.name}.csv" if whole.is_dir() else self.path.with_suffix(".csv")
        return self.out or beside


def run(config: Config) -> None:
    """List the runs, or write them."""
    from dataclasses import replace

    from experiments.common.results import write_output
    from experiments.common.table import Table
    from trackslip.errors import OutputError
    from trackslip.logs.logfile import write_csv
    from trackslip.logs.runlog import stored_geometry
    from trackslip.ros.drive_log import read_runs_of

    read = read_runs_of(config.path)
    for line in read.warnings:
        print(f"warning: {line}")
    known = {log.run: replace(log, scans=None) for log in read.runs}
    for name in config.run or ():
        if name not in known:
            more = f", ... ({len(known)} of them)" if len(known) > _SHOWN else ""
            raise InvalidValueError("run", name, f"one of {', '.join(map(repr, list(known)[:_SHOWN]))}{more}")
    logs = [known[name] for name in config.run or known]
    if not config.csv:
        lengths = (f"{log.time[-1] - log.time[0]:.2f}" for log in logs)
        rows = [
            (log.run, str(len(log.time)), length, "no" if log.truth is None else "yes")
            for log, length in zip(logs, lengths, strict=True)
        ]
        Table(f"Runs in {config.path}", ("run", "rows", "duration [s]", "truth"), rows).print()
        return
    file, about = config.file, config.file.with_suffix(".columns.csv")
    if file.exists() and file.samefile(config.path):
        raise InvalidValueError("out", str(file), "a file other than the one being read")
    for one in (file, about):
        if one.exists() and not config.overwrite:
            raise OutputError(f"{one}: exists already; --overwrite replaces it")

    def write(draft: Path) -> None:  # both files or none
        write_csv(logs, draft)
        write_output(about, lambda columns: _write_columns(logs, columns))

    write_output(file, write)
    size = counted(sum(len(log.time) for log in logs), "row")
    print(f"{file}: {counted(len(logs), 'run')}, {size}; units in {about.name}")
    geometry = stored_geometry(logs[0])
    if geometry is not None and any(log.twist_command is None for log in logs):  # not all under a controller
        options = " ".join(f"--{name.replace('_', '-')} {value:g}" for name, value in asdict(geometry).items())
        print(f"trackslip identify {file} {options}")


def _write_columns(logs: "Sequence[RunLog]", file: Path) -> None:
    """Write unit and meaning of each column of the runs to a CSV file."""
    from trackslip.logs.schema import COLUMNS
    from trackslip.logs.table import to_table

    with file.open("w", newline="", encoding="utf-8") as text:
        writer = csv.writer(text)
        writer.writerow(("column", "unit", "description"))
        columns = (COLUMNS[name] for name in to_table(logs).column_names)
        writer.writerows((column.name, column.unit, column.description) for column in columns)
