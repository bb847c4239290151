"""Columns of an arbitrary table as arrays, cell by cell: what is empty, and what is damaged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from trackslip.errors import LogError, first_line
from trackslip.kinematics import Array
from trackslip.logs.runlog import MAX_YAW_RATE
from trackslip.logs.schema import COLUMNS

_HUGE = 1e21  # no measurement in SI units is larger, nor a time in ns
_NUMBER = r"^-?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$"  # what Arrow parses
_BOOLEANS = {"true": True, "1": True, "1.0": True, "false": False, "0": False, "0.0": False}


@dataclass(frozen=True)
class Cells:
    """A column of numbers."""

    values: Array  # (T,); NaN where the cell is empty or holds no number
    nan: np.ndarray  # (T,) bool: the cell is not empty, but NaN
    damaged: np.ndarray  # (T,) bool: it holds text, infinity or a number beyond all measurements


class Columns:
    """Columns of a table as arrays; errors name the row and the column."""

    def __init__(self, table: pa.Table, source: str) -> None:
        self._table, self._source = table, source

    def require(self, names: Sequence[str]) -> None:
        """Raise LogError if one of `names` is missing or any column occurs twice."""
        found = self._table.column_names
        for name in found:
            if found.count(name) > 1:
                raise LogError(f"{self._source}: column {name} is there {found.count(name)} times")
        for name in names:
            if name not in found:
                raise LogError(f"{self._source}: column {name} is missing (found {', '.join(found)})")

    def cells(self, name: str) -> Cells:
        """A column of numbers; raises LogError for another type or unit, all NaN for a missing column."""
        if name not in self._table.column_names:
            none = np.zeros(len(self._table), bool)
            return Cells(np.full(len(none), np.nan), none, none)
        values, empty, unreadable = self._parse(name)
        damaged = unreadable | (np.abs(values) > _HUGE)
        nan = np.isnan(values) & ~empty & ~unreadable
        values[damaged] = np.nan
        return Cells(values, nan, damaged)

    def optional(self, names: Sequence[str]) -> Array | None:
        """Values (T, len(names)) with NaN for what is no number, or None if a column is missing."""
        if any(name not in self._table.column_names for name in names):
            return None
        return np.stack([self.cells(name).values for name in names], axis=-1)

    def complaint(self, name: str, row: int) -> str:
        """A complaint about a cell."""
        value = self._table.column(name)[row].as_py()
        shown = repr(value) if len(repr(value)) <= 40 else repr(value)[:40] + "…"
        expected = {"valid": "true or false", "gyro": f"a yaw rate of at most {MAX_YAW_RATE:g} rad/s"}.get(name)
        return f"row {row + 1}, column {name}: {shown} is not {expected or 'a finite number'}"

    def categories(self, name: str) -> tuple[np.ndarray, list[str]]:
        """Numbers of the texts of a column (T,), and the texts; empty cells are the empty text."""
        try:
            text = self._table.column(name).cast(pa.string()).fill_null("").combine_chunks().dictionary_encode()
        except pa.ArrowException as error:
            raise LogError(f"{self._source}: column {name}: {first_line(error)}") from error
        return text.indices.to_numpy(), text.dictionary.to_pylist()

    def boolean(self, name: str) -> Cells:
        """1 or 0, NaN where the cell is empty."""
        index, texts = self.categories(name)
        values = np.array([_BOOLEANS.get(text.lower(), np.nan) for text in texts], float)[index]
        damaged = np.array([text != "" and text.lower() not in _BOOLEANS for text in texts], bool)[index]
        return Cells(values, np.zeros(len(values), bool), damaged)

    def _parse(self, name: str) -> tuple[Array, np.ndarray, np.ndarray]:
        """Values (T,), NaN where there is none, and which cells are empty or not numbers."""
        column = self._table.column(name)
        stated = (self._table.schema.field(name).metadata or {}).get(b"unit")
        if stated is not None and name in COLUMNS:
            unit, expected = stated.decode(errors="replace"), COLUMNS[name].unit
            if unit != expected:
                raise LogError(f"{self._source}: column {name}: in {unit!r}, must be in {expected or 'no unit'}")
        if pa.types.is_string(column.type) or pa.types.is_large_string(column.type):
            return _from_text(column)
        if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
            raise LogError(f"{self._source}: column {name}: {column.type} is not a number")
        return _as_floats(column), column.is_null().to_numpy(), np.zeros(len(column), bool)


def _from_text(column: pa.ChunkedArray) -> tuple[Array, np.ndarray, np.ndarray]:
    """Values (T,) of text, NaN where it is no number, and which texts are empty or not numbers."""
    import pyarrow.compute as pc  # takes longer to import than pyarrow itself, and few logs have numbers as text

    text = pc.utf8_trim_whitespace(pc.fill_null(column, ""))
    plain = pc.match_substring_regex(text, _NUMBER)
    values = _as_floats(pc.if_else(plain, text, None))
    unreadable = np.zeros(len(values), bool)
    empty = pc.equal(text, "").to_numpy()
    others = np.flatnonzero(~plain.to_numpy() & ~empty)
    for k, other in zip(others, text.take(others).to_pylist(), strict=True):
        try:
            values[k] = float(other)
        except ValueError:
            unreadable[k] = True
    return values, empty, unreadable


def _as_floats(column: pa.ChunkedArray) -> Array:
    """A writable copy (T,) of a column, NaN for nulls."""
    return np.array(column.cast(pa.float64(), safe=False).to_numpy(), float)
