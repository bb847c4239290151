"""Slip of tracked robots: kinematics, localisation, identification, controllers. Needs no simulator."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from trackslip.errors import InvalidValueError, LogError, OutputError, TrackslipError

if TYPE_CHECKING:
    from trackslip.logs.runlog import RunLog

__all__ = ["InvalidValueError", "LogError", "OutputError", "TrackslipError", "load"]


def load(path: str | Path) -> list[RunLog]:
    """The runs in a folder of results, or in a `.parquet` or `.csv` file, each a `RunLog`.

    Raises:
        LogError: in one line, for a folder without runs, or a file that is damaged or holds none.
    """
    from trackslip.logs import logfile  # only now, so that importing trackslip is quick

    return logfile.load(path)
