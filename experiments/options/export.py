"""Options of `trackslip export`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from experiments.options.checks import refuse_unused, require_distinct
from experiments.options.help import default_is
from trackslip.errors import InvalidValueError


@dataclass(frozen=True)
class ExportConfig:
    """List the runs in a folder of results or, with --csv, write them as CSV for spreadsheets and for identify."""

    path: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUNS")]
    """Folder of results with runs.parquet, or a .parquet or .csv file of runs."""
    csv: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Write a CSV file, and beside it NAME.columns.csv with the unit and meaning of each column."""
    run: Annotated[tuple[str, ...] | None, default_is("all", "NAME ...")] = None
    """Names of the runs to list or write."""
    out: Annotated[Path | None, default_is("the name of RUNS with the suffix .csv, beside it", "FILE")] = None
    """The CSV file to write; needs --csv."""
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Replace the CSV file if it exists; needs --csv."""

    def __post_init__(self) -> None:
        if not self.csv:
            refuse_unused(self, ("out", "overwrite"), "without --csv")
        if self.out is not None and self.out.suffix.lower() != ".csv":
            raise InvalidValueError("out", str(self.out), "a file that ends in .csv")
        require_distinct("run", self.run)

    @property
    def file(self) -> Path:
        """The CSV file."""
        whole = self.path.resolve()
        beside = self.path.parent / f"{whole.name}.csv" if whole.is_dir() else self.path.with_suffix(".csv")
        return self.out or beside
