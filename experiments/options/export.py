"""Options of `trackslip export`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from trackslip.errors import InvalidValueError


@dataclass(frozen=True)
class ExportConfig:
    """List the runs in a folder of results; with --csv, write them as CSV, for spreadsheets and for identify."""

    path: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """Folder of results with runs.parquet, or a .parquet or .csv file with runs."""
    csv: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Write CSV, and beside it NAME.columns.csv with each column's unit and what it is."""
    run: tuple[str, ...] = ()
    """Names of the runs to write; by default all."""
    out: Path | None = None
    """The CSV file; by default the folder's or file's name with .csv in place of its ending, beside it."""
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Replace the file if it is there."""

    def __post_init__(self) -> None:
        if self.out is not None and self.out.suffix.lower() != ".csv":
            raise InvalidValueError("out", str(self.out), "a file that ends in .csv")
        if len(set(self.run)) < len(self.run):
            raise InvalidValueError("run", self.run, "all different")

    @property
    def file(self) -> Path:
        """The CSV file."""
        if self.out is not None:
            return self.out
        whole = self.path.resolve()
        return self.path.parent / f"{whole.name}.csv" if whole.is_dir() else self.path.with_suffix(".csv")
