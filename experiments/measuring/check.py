"""A number that has to lie within a bound."""

import math
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Check:
    """A number that has to lie within a bound."""

    case: str
    what: str
    value: float
    bound: float | tuple[float, float]
    """The largest value allowed, or the smallest and the largest, which may be infinite."""
    unit: str
    """SI, or for speeds "x", "steps/s" or "%"; 1 for a pure number."""

    @property
    def ends(self) -> tuple[float, float]:
        """The smallest and the largest value allowed."""
        return self.bound if isinstance(self.bound, tuple) else (-math.inf, self.bound)

    @property
    def holds(self) -> bool:
        """Whether the value lies within the bound; NaN does not."""
        low, high = self.ends
        return bool(low <= self.value <= high)

    def __str__(self) -> str:
        low, high = self.ends
        allowed = (
            f"at most {high:g}"
            if low == -math.inf
            else f"{low:g} to {high:g}"
            if high < math.inf
            else f"at least {low:g}"
        )
        return f"{self.case}: {self.what} {self.value:.3g}, {allowed}"

    def to_json(self) -> dict[str, Any]:
        """An entry of `checks` in a summary.json, where an end that is infinite becomes null."""
        name = f"{self.case}: {self.what}"
        return {"name": name, "value": self.value, "bound": self.bound, "unit": self.unit, "holds": self.holds}


def at_least(bound: float) -> tuple[float, float]:
    """The bound of a value that must not be smaller."""
    return bound, math.inf
