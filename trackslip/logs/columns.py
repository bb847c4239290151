"""Columns of an arbitrary table as arrays, with validation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.logs.schema import COLUMNS


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

    def numbers(self, names: Sequence[str], where: np.ndarray | None = None) -> Array:
        """Values (T, len(names)), all finite, or at least those in the rows `where`."""
        values = np.stack([self._parse(name) for name in names], axis=-1)
        bad = np.argwhere(~np.isfinite(values.T) & (True if where is None else where))
        if bad.size:
            name, k = names[bad[0, 0]], int(bad[0, 1])
            given = self._table.column(name)[k].as_py()
            raise LogError(f"{self._source}: row {k + 1}, column {name}: {given!r} is not a finite number")
        return values

    def gappy(self, names: Sequence[str]) -> Array:
        """Values (T, len(names)) with NaN for nulls and NaN."""
        return np.stack([self._parse(name) for name in names], axis=-1)

    def optional(self, names: Sequence[str]) -> Array | None:
        """Values (T, len(names)) with NaN for nulls, or None if a column is missing."""
        if any(name not in self._table.column_names for name in names):
            return None
        return np.stack([self._parse(name) for name in names], axis=-1)

    def boolean(self, name: str, label: np.ndarray) -> np.ndarray | None:
        """Values (T,), true in runs (numbered by `label` (T,)) without any; None if the column is missing."""
        if name not in self._table.column_names:
            return None
        column = self._table.column(name)
        if pa.types.is_nested(column.type):
            raise LogError(f"{self._source}: column {name}: {column.type} is not true or false")
        text = column.cast(pa.string()).to_pylist()
        known = {"true": True, "1": True, "1.0": True, "false": False, "0": False, "0.0": False}
        given = np.array([value not in (None, "") for value in text])
        lacking = np.bincount(label, given) == 0  # runs
        for k, value in enumerate(text):
            if str(value).lower() not in known and not lacking[label[k]]:
                raise LogError(f"{self._source}: row {k + 1}, column {name}: {value!r} is not true or false")
        return np.array([known.get(str(value).lower(), True) for value in text])

    def _parse(self, name: str) -> Array:
        column = self._table.column(name)
        stated = (self._table.schema.field(name).metadata or {}).get(b"unit")
        if stated is not None and name in COLUMNS:
            unit, expected = stated.decode(errors="replace"), COLUMNS[name].unit
            if unit != expected:
                raise LogError(f"{self._source}: column {name}: in {unit!r}, must be in {expected or 'no unit'}")
        if not (pa.types.is_string(column.type) or pa.types.is_large_string(column.type)):
            if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
                raise LogError(f"{self._source}: column {name}: {column.type} is not a number")
            return np.asarray(column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False), float)
        values = np.full(len(column), np.nan)
        for k, text in enumerate(column.to_pylist()):
            if text:
                try:
                    values[k] = float(text)
                except ValueError:
                    raise LogError(f"{self._source}: row {k + 1}, column {name}: {text!r} is not a number") from None
        return values
