"""A row for each run of a sweep, as a table with units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

COLUMNS: dict[str, tuple[str, str]] = {
    "run": ("", "name of the run: its log in runs.parquet"),
    "id": ("", "hash of all that the run is: options, robot, ground, seed"),
    "error": ("", "why there is no run; null where there is one"),
    "omega_l": ("rad/s", "measured speed of the left sprocket"),
    "omega_r": ("rad/s", "measured speed of the right sprocket"),
    "v": ("m/s", "measured forward speed"),
    "w": ("rad/s", "measured yaw rate"),
    "observed_radius": ("m", "measured radius, positive to the left"),
    "slip_l": ("-", "measured slip of the left track"),
    "slip_r": ("-", "measured slip of the right track"),
    "true_slip_l": ("-", "true slip of the left track"),
    "true_slip_r": ("-", "true slip of the right track"),
    "note": ("", "what of the run could not be used, and why; null where all could"),
    "rmse_x": ("m", "root mean square error of the poses along x"),
    "rmse_y": ("m", "root mean square error of the poses along y"),
    "rmse_heading": ("rad", "root mean square error of the headings"),
    "valid_fraction": ("-", "share of the scans that gave a pose"),
    "saturated": ("-", "share of the time with a motor at its limit, the worse track"),
    "made_by": ("", "digest of the code, models and libraries that drove it, listed in summary.json"),
}
"""Unit and meaning of the columns, besides the axes of the sweep, which come after `id`."""
AXES: dict[str, tuple[str, str]] = {
    "radius": ("m", "radius of the no-slip command"),
    "speed": ("m/s", "speed of the no-slip command"),
    "friction_ratio": ("-", "friction across the track over friction along it"),
    "slope": ("rad", "angle of the ground to the horizontal"),
    "ground": ("", "name or file of the ground"),
    "seed": ("", "root of all random numbers"),
}


_LARGEST = 2**63 - 1
"""Integer of a column; larger ones, seeds, are text."""


def write_table(rows: Sequence[Mapping[str, Any]], axes: Sequence[str], path: Path) -> None:
    """Write the rows of a sweep to a Parquet file; units and meanings are in the columns' metadata."""
    first, last = [*COLUMNS][:2], [*COLUMNS][2:]
    about = {axis: AXES.get(axis, ("", f"the option {axis}")) for axis in axes}
    columns = {name: COLUMNS.get(name) or about[name] for name in (*first, *axes, *last)}
    arrays = [_column([row.get(name) for row in rows], name) for name in columns]
    fields = [
        pa.field(name, array.type, metadata={"unit": unit, "description": description})
        for (name, (unit, description)), array in zip(columns.items(), arrays, strict=True)
    ]
    pa.parquet.write_table(pa.table(arrays, schema=pa.schema(fields)), path)


def _column(values: list[Any], name: str) -> pa.Array:
    """A column of the type that its values have; text where there are none, or of several kinds."""
    kinds = {type(value) for value in values if value is not None}
    if kinds == {int} and max(value for value in values if value is not None) > _LARGEST:
        kinds = {str}
    if kinds <= {int, float} and (kinds or COLUMNS.get(name, ("",))[0]):
        return pa.array(values, pa.int64() if kinds == {int} else pa.float64())
    if kinds == {bool}:
        return pa.array(values, pa.bool_())
    return pa.array([None if value is None else str(value) for value in values], pa.string())


def markdown() -> str:
    """COLUMNS and AXES as a table, for docs/data.md."""
    rows = [
        f"| `{name}` | {unit or '–'} | {description} |"
        for columns in (COLUMNS, AXES)
        for name, (unit, description) in columns.items()
    ]
    return "\n".join(["| column | unit | what |", "|---|---|---|", *rows, ""])


if __name__ == "__main__":
    print(markdown(), end="")
