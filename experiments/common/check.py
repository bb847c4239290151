"""Checks: measured numbers against what theory, or a requirement, expects of them, and their table."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from experiments.common.table import MISSING, Table, number, percent, significant

_SHOWN = {"m": (1e3, "mm", 3), "s": (1e3, "ms", 3), "rad": (1e3, "mrad", 3)}  # scale, unit and decimals
_MOST_COLUMNS = 4  # cases that fit side by side
_SHARE = 0.2  # largest bound of an error that is printed in per cent, and of a length or speed in millimetres


@dataclass(frozen=True)
class Check:
    """A measured number that must lie near an expected one, or within a range."""

    case: str
    """Subject of the measurement, such as a robot."""
    what: str
    """The quantity."""
    measured: float
    tolerance: float | tuple[float, float]
    """The largest deviation from `expected`; or the least and the greatest value allowed, which may be infinite."""
    unit: str = "1"
    """SI, or for speeds "x", "steps/s" or "%"; 1 for a pure number."""
    expected: float = 0.0
    source: str = ""
    """Source of `expected` and `tolerance`."""

    @property
    def name(self) -> str:
        """Case and quantity."""
        return f"{self.case}: {self.what}"

    @property
    def ends(self) -> tuple[float, float]:
        """The least and the greatest value allowed."""
        if isinstance(self.tolerance, tuple):
            return self.tolerance
        return self.expected - self.tolerance, self.expected + self.tolerance

    @property
    def bound(self) -> float | tuple[float, float]:
        """The bound as shown: one number for a tolerance around 0, else a range."""
        return self.ends if self.expected else self.tolerance

    @property
    def holds(self) -> bool:
        """True if the value lies within the range; NaN does not."""
        low, high = self.ends
        return bool(low <= self.measured <= high)

    def __str__(self) -> str:
        low, high = self.ends
        allowed = f"{low:g} to {high:g}" if high < math.inf else f"at least {low:g}"
        if not isinstance(self.bound, tuple):
            allowed = f"at most {self.bound:g}"
        return f"{self.name} {self.measured:.3g}, {allowed}"

    def to_json(self) -> dict[str, Any]:
        """An entry of `checks` in a summary.json, where an end that is infinite becomes null."""
        expected = None if isinstance(self.tolerance, tuple) else self.expected
        entry = {"name": self.name, "value": self.measured, "expected": expected, "bound": self.bound}
        return {**entry, "unit": self.unit, "holds": self.holds, "source": self.source}


def at_least(least: float) -> tuple[float, float]:
    """The range of a value that must not be smaller."""
    return least, math.inf


def checks_table(title: str, checks: Sequence[Check]) -> Table:
    """A row per check; up to four cases that share their bounds are side by side, others one below the other."""
    cases, bounds = list(dict.fromkeys(check.case for check in checks)), {check.what: check for check in checks}
    shared = all(check.bound == bounds[check.what].bound for check in checks)
    if len(cases) > _MOST_COLUMNS or not shared:
        return _listed(title, checks)
    measured = {(check.case, check.what): _value(check) for check in checks}
    cells = {what: [measured.get((case, what), MISSING) for case in cases] for what in bounds}
    rows = [(what, *values, _bound(bounds[what])) for what, values in cells.items()]
    return Table(title, ("check", *cases, "bound"), rows)


def _listed(title: str, checks: Sequence[Check]) -> Table:
    rows: list[tuple[str, ...]] = []
    for case, group in groupby(checks, key=lambda check: check.case):
        rows.append((case, "", "", "", ""))
        for check in group:
            scale, unit, digits = _SHOWN.get(check.unit, (1.0, "", 4))
            ends = check.bound if isinstance(check.bound, tuple) else (check.bound,)
            bound = " to ".join(number(scale * end, digits) for end in ends)
            value, holds = number(scale * check.measured, digits), "holds" if check.holds else "does not hold"
            rows.append((f"  {check.what}", value, bound, unit, holds))
    return Table(title, ("case", "value", "bound", "unit", ""), rows)


def _value(check: Check) -> str:
    return _in_its_unit(check, check.measured) + ("" if check.holds else " !")


def _bound(check: Check) -> str:
    low, high = (_in_its_unit(check, end) for end in check.ends)
    if math.isinf(check.ends[1]):
        return f">= {low}"
    return f"{low} to {high}" if isinstance(check.bound, tuple) else high


def _in_its_unit(check: Check, value: float) -> str:
    """A value as a reader expects it: errors in per cent, angles in degrees, lengths in millimetres."""
    most = max(map(abs, check.ends))
    if check.unit == "1":
        return percent(value) if 0 < most <= _SHARE else significant(value)
    if check.unit == "rad":
        return significant(math.degrees(value), "deg")
    if check.unit in ("m", "m/s") and most < _SHARE:
        return significant(1e3 * value, f"m{check.unit}")
    return significant(value, check.unit)
