"""What the tracks stand on."""

from __future__ import annotations

from dataclasses import dataclass

from trackslip.errors import require_at_most, require_positive


@dataclass(frozen=True)
class Ground:
    """Coulomb friction, along and across the tracks.

    Slip depends on the ratio of the two, not on their size. The default is stone paving under tracks whose treads grip
    better sideways; its ratio is tuned so that the robot drives the radii that the paper observed.
    """

    along: float = 0.70
    """Friction coefficient along the track [-]."""
    across: float = 0.775
    """Friction coefficient across the track [-]."""

    def __post_init__(self) -> None:
        require_positive("along", self.along)
        require_positive("across", self.across)
        require_at_most("along", self.along, 10.0)
        require_at_most("across", self.across, 10.0)
