"""Errors of odometry as a table: a row for each law, kind of error and length."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from experiments.measuring.odometry import Evaluated
from trackslip.logs.schema import NO_UNIT, PURE, Column
from trackslip.odometry.evaluation import PoseErrors

_KINDS = ("rms", "mean", "median", "largest")
COLUMNS = (
    Column("law", NO_UNIT, "label of the law"),
    Column("kind", NO_UNIT, "aligned or from_first (absolute), metres or seconds (relative)"),
    Column("length", NO_UNIT, "length of the stretches, in m or s"),
    Column("count", PURE, "number of stretches"),
    *(Column(f"position_{kind}", "m", f"{kind} error of position") for kind in _KINDS),
    *(Column(f"heading_{kind}", "rad", f"{kind} error of heading") for kind in _KINDS),
    Column("position_per_way", PURE, "sum of the errors of position over that of the ways driven"),
    Column("heading_per_way", "rad/m", "sum of the errors of heading over that of the ways driven"),
)
"""Columns of the table; empty where there is nothing."""
_TEXTS = ("law", "kind")


def write_error_table(found: Sequence[Evaluated], path: Path) -> None:
    """Write the errors of laws to a Parquet file, with units and meanings in the columns' metadata."""
    rows = [row for one in found for row in _rows(one)]
    arrays = [
        pa.array([row.get(column.name) for row in rows], pa.string() if column.name in _TEXTS else pa.float64())
        for column in COLUMNS
    ]
    pairs = zip(COLUMNS, arrays, strict=True)
    fields = [pa.field(column.name, array.type, metadata=column.metadata) for column, array in pairs]
    pa.parquet.write_table(pa.table(arrays, schema=pa.schema(fields)), path, write_page_checksum=True)


def _rows(one: Evaluated) -> Iterator[dict[str, Any]]:
    errors = one.errors
    for kind, absolute in (("aligned", errors.aligned), ("from_first", errors.from_first)):
        yield {"law": one.label, "kind": kind} | _statistics(absolute)
    for kind, by_length in (("metres", errors.after_metres), ("seconds", errors.after_seconds)):
        for length, relative in by_length.items():
            ratios = {name: getattr(relative, name) for name in ("position_per_way", "heading_per_way")}
            about = {"law": one.label, "kind": kind, "length": length, "count": relative.count}
            yield about | _statistics(relative) | {key: value for key, value in ratios.items() if value == value}


def _statistics(errors: PoseErrors) -> dict[str, float]:
    parts = (("position", errors.position), ("heading", errors.heading))
    return {f"{name}_{kind}": getattr(part, kind) for name, part in parts if part is not None for kind in _KINDS}
