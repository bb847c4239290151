"""Results as Arrow tables, in SI units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import singledispatch
from typing import Any, Final

import numpy as np
import pyarrow as pa

from trackslip.benchmark import BenchmarkResults
from trackslip.identification.common_law import LogComparison
from trackslip.identification.comparison import FittedLaw
from trackslip.identification.result import Identification
from trackslip.laws.base import SlipLaw
from trackslip.laws.families import FAMILIES
from trackslip.logs.runlog import RunLog
from trackslip.logs.table import to_table
from trackslip.metrics import TrackingErrors
from trackslip.odometry.evaluation import OdometryErrors
from trackslip.views.symbols import symbol
from trackslip.views.values import law_parameters

_STATISTICS: Final = ("median", "p90", "rms", "mean", "largest")
_UNITS: Final = {"position": "m", "heading": "rad"}  # of the errors of odometry

Row = dict[str, Any]


def table(result: object) -> pa.Table:
    """The Arrow table of a result."""
    of_result: pa.Table = _table(result)
    return of_result


def _of_rows(rows: Sequence[Row], schema: pa.Schema) -> pa.Table:
    return pa.Table.from_pylist([*rows], schema=schema)


@singledispatch
def _table(result: object) -> pa.Table:
    """The table of a result, by its class or the next class above it."""
    raise NotImplementedError(f"{type(result).__name__} has no view")


@_table.register(SlipLaw)
def _law(law: SlipLaw) -> pa.Table:
    """A row for each parameter; with many laws in one object, for each parameter of each law."""
    rows = list[Row]()
    for parameter in law_parameters(law):
        for number, value in enumerate(parameter.values.tolist()):
            rows.append(
                {
                    "law": number,
                    "parameter": parameter.name,
                    "symbol": parameter.symbol,
                    "value": value,
                    "unit": parameter.unit,
                    "meaning": parameter.meaning,
                }
            )
    return _of_rows(rows, _LAW)


@_table.register(RunLog)
def _log(log: RunLog) -> pa.Table:
    """A row for each scan, with the columns of a log file."""
    return to_table([log])


@_table.register(Identification)
def _identification(result: Identification) -> pa.Table:
    """A row for each multiplier of the answer, and then for each parameter of each law."""
    rows = list[Row]()
    for name, gain in result.answer.items():
        if name.endswith("multiplier"):
            ends = (gain.low, gain.high)
            note = result.undetermined.get(name, "")
            row = {"law": result.expressible, "parameter": name, "symbol": name, "unit": ""}
            rows.append(row | _value(gain.value, ends) | {"note": note})
    for fit in result.main.laws.values():
        rows += _parameters(fit)
    return _of_rows([{**row, "best": row["law"] == result.best} for row in rows], _FITTED)


def _parameters(fit: FittedLaw) -> list[Row]:
    """Rows for the parameters of a law."""
    family = FAMILIES[fit.name]
    rows = list[Row]()
    for name, value in fit.values.items():
        row = {
            "law": fit.name,
            "parameter": name,
            "symbol": symbol(fit.name, name),
            "unit": family.parameters[name].unit,
            "note": fit.held.get(name, ""),
        }
        rows.append(row | _value(value, fit.interval95.get(name)))
    return rows


def _value(value: float, ends: Sequence[float] | None) -> Row:
    """A value with the ends of its interval, as null where unknown."""
    low, high = (None, None) if ends is None else ends
    known = {"value": value, "low": low, "high": high}
    return {name: None if x is None or np.isnan(x) else x for name, x in known.items()}


@_table.register(OdometryErrors)
def _odometry(errors: OdometryErrors) -> pa.Table:
    """A row for each distance and each time after which errors are known."""
    rows = list[Row]()
    for unit, by_length in (("m", errors.after_metres), ("s", errors.after_seconds)):
        for length, ahead in by_length.items():
            row: Row = {"after": length, "unit": unit, "stretches": ahead.count}
            for quantity in _UNITS:
                part = getattr(ahead, quantity)
                for statistic in _STATISTICS:
                    value = None if part is None else getattr(part, statistic)
                    row[f"{quantity}_{statistic}"] = value
            rows.append(row)
    return _of_rows(rows, _ODOMETRY)


@_table.register(TrackingErrors)
def _tracking(errors: TrackingErrors) -> pa.Table:
    """One row with a column for each error."""
    return pa.Table.from_pylist([asdict(errors)])


@_table.register(BenchmarkResults)
def _benchmark(results: BenchmarkResults) -> pa.Table:
    """A row for each entry of the leaderboard; intervals are two columns, _low and _high."""
    rows = list[Row]()
    for entry in results.entries:
        row: Row = {}
        for name, value in entry.items():
            if name.endswith("_ci95"):
                low, high = (None, None) if value is None else value
                row |= {f"{name}_low": low, f"{name}_high": high}
            elif not isinstance(value, Mapping | list):
                row[name] = value
        rows.append(row)
    return pa.Table.from_pylist(rows)


@_table.register(LogComparison)
def _comparison(comparison: LogComparison) -> pa.Table:
    """A row for each log and multiplier, with the cost of one law for all."""
    rows = list[Row]()
    for log, of_log in comparison.values.items():
        ratio = comparison.costs[log].ratio
        cost = {f"ratio_{end}": x for end, x in _value(ratio.value, ratio[1:]).items()}
        for multiplier, gain in of_log.items():
            row = {"log": log, "multiplier": multiplier, **_value(gain.value, gain[1:])}
            rows.append({**row, **cost, "served": comparison.costs[log].verdict})
    return _of_rows(rows, _COMPARISON)


_LAW: Final = pa.schema(
    {
        "law": pa.int64(),
        "parameter": pa.string(),
        "symbol": pa.string(),
        "value": pa.float64(),
        "unit": pa.string(),
        "meaning": pa.string(),
    }
)
_FITTED: Final = pa.schema(
    {
        "law": pa.string(),
        "best": pa.bool_(),
        "parameter": pa.string(),
        "symbol": pa.string(),
        "value": pa.float64(),
        "low": pa.float64(),
        "high": pa.float64(),
        "unit": pa.string(),
        "note": pa.string(),
    }
)
_ODOMETRY: Final = pa.schema(
    [
        ("after", pa.float64()),
        ("unit", pa.string()),
        ("stretches", pa.int64()),
        *(
            pa.field(f"{quantity}_{statistic}", pa.float64(), metadata={"unit": unit})
            for quantity, unit in _UNITS.items()
            for statistic in _STATISTICS
        ),
    ]
)
_COMPARISON: Final = pa.schema(
    {
        "log": pa.string(),
        "multiplier": pa.string(),
        "value": pa.float64(),
        "low": pa.float64(),
        "high": pa.float64(),
        "ratio_value": pa.float64(),
        "ratio_low": pa.float64(),
        "ratio_high": pa.float64(),
        "served": pa.string(),
    }
)
