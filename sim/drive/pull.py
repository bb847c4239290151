"""The pull of a towed load."""

from dataclasses import dataclass

from trackslip.errors import Checked, checked, require_non_negative

MAX_FORCE = 1e5
"""Largest pull [N]."""


@dataclass(frozen=True)
class Pull(Checked):
    """A horizontal force on the hitch, backwards along the robot."""

    force: float = checked(0.0, require_non_negative, MAX_FORCE, "N")
    """Force [N]."""
    height: float = checked(0.1, require_non_negative, 10.0, "m")
    """Height of the hitch above the ground [m]."""
    since: float = checked(0.0, require_non_negative)
    """Time since the start of a run at which the force begins to act [s]."""
