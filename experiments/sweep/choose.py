"""Choose runs of a stored sweep by the values of its axes."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from experiments.storage.results import TABLE_FILE
from experiments.sweep.rows import COLUMNS
from trackslip.errors import InvalidValueError
from trackslip.logs.logfile import read_table

_SHOWN = 10


def chosen(folder: Path, where: Sequence[str]) -> set[str]:
    """Names of the runs for which every NAME=VALUE of `where` holds.

    Raises:
        InvalidValueError: for an axis or a value that the sweep doesn't have.
        LogError: for a folder without a table of its runs.
    """
    rows: list[dict[str, Any]] = read_table(folder / TABLE_FILE).to_pylist()
    axes = [name for name in rows[0] if name not in COLUMNS] if rows else []
    for text in where:
        name, _, value = text.partition("=")
        if name not in axes:
            raise InvalidValueError("where", text, f"NAME=VALUE with one of {', '.join(axes)}")
        there = list(dict.fromkeys(row[name] for row in rows))
        rows = [row for row in rows if _is(row[name], value)]
        if not rows:
            raise InvalidValueError("where", text, f"{name}=one of {', '.join(map(str, there[:_SHOWN]))}")
    return {row["run"] for row in rows}


def _is(value: Any, text: str) -> bool:
    """Whether a value equals its text."""
    if str(value) == text or (isinstance(value, bool) and str(value).lower() == text):
        return True
    with contextlib.suppress(ValueError):
        return isinstance(value, int | float) and float(text) == value
    return False
