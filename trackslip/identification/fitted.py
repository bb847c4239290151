"""Laws with identified values, errors and intervals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from trackslip.kinematics import Array
from trackslip.laws.base import SlipLaw


@dataclass(frozen=True, kw_only=True)
class FittedLaw:
    """A law with values that were identified, from steady samples or whole drives."""

    name: str
    """Name of the family."""
    law: SlipLaw
    """The law with the values below."""
    values: dict[str, float]
    """Parameters of the law by name, in their units."""
    stderr: dict[str, float]
    """Standard errors of the fitted parameters."""
    interval95: dict[str, tuple[float, float]]
    """95 % intervals of the fitted parameters."""
    correlation: Array  # of the fitted parameters, in the order of stderr

    @property
    def determined(self) -> bool:
        """True if the data determine the law."""
        return True

    @property
    def stored(self) -> dict[str, Any]:
        """The entry of the law in the `slip_laws` of a file."""
        errors = {name: self.stderr.get(name) for name in self.values}  # None for a value that was held
        return {"values": self.values, "stderr": errors, "interval95": self.interval95}
