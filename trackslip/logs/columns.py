"""Columns of any table as arrays, with masks for empty and damaged cells."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from typing import Final

import numpy as np
import pyarrow as pa

from trackslip.errors import LogError, first_line
from trackslip.kinematics import Array
from trackslip.logs.layout import SCALE, UNITS
from trackslip.logs.runlog import MAX_YAW_RATE
from trackslip.logs.schema import READ

HUGE: Final = 1e21  # no measurement in SI units and no time in ns is larger
_BOOLEANS: Final = {
    "true": 1.0,
    "1": 1.0,
    "1.0": 1.0,
    "false": 0.0,
    "0": 0.0,
    "0.0": 0.0,
    "": np.nan,
}
# seconds per unit of Arrow's times
_TIME_UNITS: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_EXPECTED: Final = {
    "valid": "true or false",
    "gyro": f"a yaw rate of at most {MAX_YAW_RATE:g} rad/s",
}


@dataclass(frozen=True)
class Cells:
    """A column of numbers, with masks for empty and damaged cells."""

    values: Array  # (T,); NaN where the cell is empty, NaN or damaged
    empty: np.ndarray  # (T,) bool
    # (T,) bool: the cell holds text, infinity or a number too large for a measurement
    damaged: np.ndarray


@dataclass(frozen=True)
class Lists:
    """A column of lists of numbers."""

    numbers: np.ndarray  # (n,) float32: the numbers in all lists, in order
    lengths: np.ndarray  # (T,) int: number of numbers in each list, 0 where the cell is empty
    empty: np.ndarray  # (T,) bool

    def take(self, rows: np.ndarray) -> tuple[Array, np.ndarray]:
        """The numbers (m,) in the lists in `rows` (R,), in order, and their lengths (R,)."""
        lengths = self.lengths[rows]
        # from places in the result to places in `numbers`
        shift = self._starts[rows] - (np.cumsum(lengths) - lengths)
        places = np.arange(lengths.sum()) + np.repeat(shift, lengths)
        return np.asarray(self.numbers[places], float), lengths

    @cached_property
    def _starts(self) -> np.ndarray:
        """Place (T,) in `numbers` at which each list begins."""
        return np.asarray(np.cumsum(self.lengths) - self.lengths)


class Columns:
    """A table's columns as arrays; errors name the row and the column.

    Rows are counted from `first_row`, for a part of a table.
    """

    def __init__(self, table: pa.Table, source: str, first_row: int = 0) -> None:
        self._table = table
        self._source = source
        self._first_row = first_row

    def require(self, names: Sequence[str]) -> None:
        """Raise LogError if one of `names` is missing or any column occurs twice."""
        present = self._table.column_names
        if missing := [name for name in names if name not in present]:
            raise LogError(
                f"{self._source}: has no column {', '.join(missing)}; found "
                f"{', '.join(present)[:200]!r}"
            )
        for name, count in Counter(present).items():
            if count > 1:
                raise LogError(f"{self._source}: column {name} is there {count} times")

    def cells(self, name: str) -> Cells:
        """Read a column of numbers in our unit; a missing column has empty cells. Raises LogError
        for a wrong type or unit.
        """
        if name not in self._table.column_names:
            nowhere = np.zeros(len(self._table), bool)
            return Cells(np.full(len(nowhere), np.nan), ~nowhere, nowhere)
        metadata = self._table.schema.field(name).metadata or {}
        self._require_unit(name, metadata)
        scale = float(metadata.get(SCALE, b"1"))
        column = self._table.column(name)
        kind = column.type
        if _is_text(kind):
            cells = _from_text(column)
            has_no_number = (cells.damaged | cells.empty).all() and cells.damaged.any()
            if name == "t" and has_no_number:
                return _from_dates(column)
            return _scaled(cells, scale)
        if name == "t" and (pa.types.is_timestamp(kind) or pa.types.is_duration(kind)):
            scale = _TIME_UNITS[kind.unit]
            column = column.cast(pa.int64())
        elif not (
            pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind)
        ):
            raise LogError(f"{self._source}: column {name}: {kind} is not a number")
        return _scaled(_cells(_as_floats(column), column.is_null().to_numpy()), scale)

    def any_numbers(self, name: str) -> Array:
        """Values (n,) of a column; none if it isn't a column of numbers."""
        try:
            return self.cells(name).values
        except LogError:
            return np.zeros(0)

    def _require_unit(self, name: str, metadata: Mapping[bytes, bytes]) -> None:
        """Raise LogError if the `metadata` of a column state another unit than ours."""
        stated = metadata.get(b"unit")
        if stated is None or name not in READ:
            return
        unit = stated.decode(errors="replace")
        expected = READ[name].unit
        if unit == expected:
            return
        known = unit in UNITS.get(expected, {})
        option = f"; --columns {name}={name}:{unit} converts it" if known else ""
        raise LogError(
            f"{self._source}: column {name}: in {unit!r}, must be in "
            f"{expected or 'no unit'}{option}"
        )

    def optional(self, names: Sequence[str], infinite: bool = False) -> Array | None:
        """Values (T, len(names)) of optional columns, NaN in cells without a number; None if any
        column is missing. With `infinite`, infinity is a number.
        """
        if any(name not in self._table.column_names for name in names):
            return None
        cells = [self.cells(name) for name in names]
        return np.stack(
            [np.where(c.damaged, np.inf, c.values) if infinite else c.values for c in cells],
            axis=-1,
        )

    def complaint(self, name: str, row: int) -> str:
        """An error message about a damaged cell."""
        shown = repr(self._table.column(name)[row].as_py())
        shown = shown if len(shown) <= 40 else shown[:40] + "…"
        expected = _EXPECTED.get(name, "a finite number")
        if name == "t" and ":" in shown:
            expected = "a number or a date with a time, as 2026-05-03T10:00:00.25"
        return f"row {self._first_row + row + 1}, column {name}: {shown} is not {expected}"

    def categories(self, name: str) -> tuple[np.ndarray, list[str]]:
        """The index (T,) of each cell's text, and the distinct texts, in a text column; nulls count
        as empty texts.
        """
        try:
            text = (
                self._table.column(name)
                .cast(pa.string())
                .fill_null("")
                .combine_chunks()
                .dictionary_encode()
            )
        except pa.ArrowException as error:
            raise LogError(f"{self._source}: column {name}: {first_line(error)}") from error
        return text.indices.to_numpy(), text.dictionary.to_pylist()

    def lists(self, name: str) -> Lists | None:
        """A column of lists of numbers; None if the column is missing or has another type."""
        if name not in self._table.column_names:
            return None
        column = self._table.column(name)
        if not pa.types.is_list(column.type) or not pa.types.is_floating(column.type.value_type):
            return None
        lengths = [np.asarray(chunk.value_lengths().fill_null(0)) for chunk in column.chunks]
        numbers = [np.asarray(chunk.flatten().fill_null(np.nan)) for chunk in column.chunks]
        return Lists(
            np.concatenate([np.zeros(0), *numbers], dtype=np.float32),
            np.concatenate([np.zeros(0, int), *lengths]),
            column.is_null().to_numpy(),
        )

    def boolean(self, name: str) -> Cells:
        """Read a column of true and false as 1 and 0; a missing column has empty cells."""
        if name not in self._table.column_names:
            return self.cells(name)
        index, texts = self.categories(name)
        values = np.array([_BOOLEANS.get(text.lower(), np.inf) for text in texts], float)[index]
        return _cells(values, np.isnan(values))


def _is_text(kind: pa.DataType) -> bool:
    """True for any of Arrow's types of text."""
    return bool(
        pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_string_view(kind)
    )


def _scaled(cells: Cells, scale: float) -> Cells:
    """Cells with their values converted to our unit."""
    return cells if scale == 1.0 else replace(cells, values=cells.values * scale)


def _cells(values: Array, empty: np.ndarray) -> Cells:
    """Cells from values (T,); infinite and huge values count as damaged."""
    damaged = np.abs(values) > HUGE
    return Cells(np.where(damaged, np.nan, values), empty, damaged)


def _from_text(column: pa.ChunkedArray) -> Cells:
    """Cells from a text column, with numbers in Python's notation."""
    import pyarrow.compute as pc  # a slow import, and few logs have numbers as text

    text = pc.utf8_trim_whitespace(pc.fill_null(column.cast(pa.string()), ""))
    empty = pc.equal(text, "")
    try:
        values = _as_floats(pc.if_else(empty, None, text))
    except pa.ArrowInvalid:  # Arrow doesn't accept some text as a number
        values = np.array([_number(cell) for cell in text.to_pylist()])
    return _cells(values, empty.to_numpy())


def _from_dates(column: pa.ChunkedArray) -> Cells:
    """Cells from a text column of dates with times, as seconds since 1970; a date without a time
    zone is in UTC.
    """
    seconds = np.array([_seconds(cell or "") for cell in column.to_pylist()])
    return _cells(seconds, np.isnan(seconds))


def _seconds(text: str) -> float:
    """Seconds from 1970 to a date in ISO 8601: NaN for an empty text, infinity for one that is no
    date.
    """
    if not text.strip():
        return np.nan
    try:
        date = datetime.fromisoformat(text.strip())
    except ValueError:
        return np.inf
    return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()


def _number(text: str) -> float:
    """The number in a text: NaN for an empty text, infinity for a text that is not a number."""
    try:
        return float(text or "nan")
    except ValueError:
        return np.inf


def _as_floats(column: pa.ChunkedArray) -> Array:
    """Values (T,) of a column, NaN for nulls."""
    return np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), float)
