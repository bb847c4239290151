"""Checks: measured numbers compared with what theory or a requirement expects, and their table."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from experiments.common.table import Table, percent, significant

# errors, lengths and speeds with smaller bounds are printed in per cent, mm and mm/s
_SHARE: Final = 0.2


@dataclass(frozen=True)
class Check:
    """A measured number that must lie near an expected number, or within a range."""

    case: str
    """Subject of the measurement, such as a robot."""
    what: str
    """The measured quantity."""
    measured: float
    tolerance: float | tuple[float, float]
    """Largest deviation from `expected`, or a pair of the least and greatest allowed values, which
    may be infinite.
    """
    unit: str = "1"
    """SI unit, 1 for a pure number; "x", "steps/s" or "%" for computing speeds."""
    expected: float = 0.0
    source: str = ""
    """Source of `expected` and `tolerance`."""

    @property
    def name(self) -> str:
        """Name of the check: its case and quantity."""
        return f"{self.case}: {self.what}"

    @property
    def ends(self) -> tuple[float, float]:
        """The least and the greatest value allowed."""
        if isinstance(self.tolerance, tuple):
            return self.tolerance
        return self.expected - self.tolerance, self.expected + self.tolerance

    @property
    def bound(self) -> float | tuple[float, float]:
        """The bound to show: one number for a tolerance around 0, otherwise a range."""
        return self.ends if self.expected else self.tolerance

    @property
    def holds(self) -> bool:
        """Whether the measured value is within the allowed range; NaN never is."""
        low, high = self.ends
        return bool(low <= self.measured <= high)

    def __str__(self) -> str:
        low, high = self.ends
        allowed = f"{low:g} to {high:g}" if high < math.inf else f"at least {low:g}"
        if not isinstance(self.bound, tuple):
            allowed = f"at most {self.bound:g}"
        return f"{self.name} {self.measured:.3g}, {allowed}"

    def to_json(self) -> dict[str, Any]:
        """The check as an entry of `checks` in summary.json, which stores infinite bounds as
        null.
        """
        expected = None if isinstance(self.tolerance, tuple) else self.expected
        return {
            "name": self.name,
            "value": self.measured,
            "expected": expected,
            "bound": self.bound,
            "unit": self.unit,
            "holds": self.holds,
            "source": self.source,
        }


def checks_table(title: str, checks: Sequence[Check]) -> Table:
    """A table with a row per check."""
    rows = []
    previous = None
    for check in checks:
        case = "" if check.case == previous else check.case
        previous = check.case
        value = _in_its_unit(check, check.measured)
        verdict = "holds" if check.holds else "does not hold"
        rows.append((case, check.what, value, _bound(check), verdict))
    return Table(title, ("case", "check", "value", "bound", ""), rows, "llrrl")


def _bound(check: Check) -> str:
    low, high = (_in_its_unit(check, end) for end in check.ends)
    if math.isinf(check.ends[1]):
        return f">= {low}"
    return f"{low} to {high}" if isinstance(check.bound, tuple) else high


def _in_its_unit(check: Check, value: float) -> str:
    """Format a value in a readable unit: small ratios in per cent, angles in degrees, short lengths
    in millimetres.
    """
    most = max(map(abs, check.ends))
    if check.unit == "1":
        return percent(value) if 0 < most <= _SHARE else significant(value)
    if check.unit == "rad":
        return significant(math.degrees(value), "deg")
    if check.unit in ("m", "m/s") and most < _SHARE:
        return significant(1e3 * value, f"m{check.unit}")
    return significant(value, check.unit)
