"""Checks: measured numbers against what theory, or a requirement, expects of them."""

import math
from dataclasses import dataclass
from typing import Any


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
        if self.bound == self.tolerance and not isinstance(self.tolerance, tuple):
            allowed = f"at most {self.tolerance:g}"
        return f"{self.name} {self.measured:.3g}, {allowed}"

    def to_json(self) -> dict[str, Any]:
        """An entry of `checks` in a summary.json, where an end that is infinite becomes null."""
        return {
            "name": self.name,
            "value": self.measured,
            "expected": None if isinstance(self.tolerance, tuple) else self.expected,
            "bound": self.bound,
            "unit": self.unit,
            "holds": self.holds,
            "source": self.source,
        }


def at_least(least: float) -> tuple[float, float]:
    """The range of a value that must not be smaller."""
    return least, math.inf
