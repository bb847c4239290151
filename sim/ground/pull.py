"""Loads that robots tow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from trackslip.errors import Checked, checked, require_non_negative

MAX_FORCE: Final = 1e5
"""Largest force of a pull [N]."""


@dataclass(frozen=True)
class Pull(Checked):
    """A horizontal force on the hitch that pulls the robot backwards."""

    force: float = checked(0.0, require_non_negative, MAX_FORCE, "N")
    """Magnitude of the force [N]."""
    height: float = checked(0.1, require_non_negative, 10.0, "m")
    """Height of the hitch above the ground [m]."""
    since: float = checked(0.0, require_non_negative)
    """Time from the start of a run until the force begins to act [s]."""
