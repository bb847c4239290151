"""The pull of a towed load."""

from dataclasses import dataclass

from trackslip.errors import require_at_most, require_non_negative

MAX_FORCE = 1e5
"""Largest pull [N]."""


@dataclass(frozen=True)
class Pull:
    """A horizontal force on the hitch, backwards along the robot."""

    force: float = 0.0
    """Force [N]."""
    height: float = 0.1
    """Height of the hitch above the ground [m]."""
    since: float = 0.0
    """Time since the start of a run at which the force begins to act [s]."""

    def __post_init__(self) -> None:
        for name in ("force", "height", "since"):
            require_non_negative(name, getattr(self, name))
        require_at_most("force", self.force, MAX_FORCE, "N")
        require_at_most("height", self.height, 10.0, "m")
