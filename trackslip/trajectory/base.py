"""The protocol of references."""

from __future__ import annotations

from typing import Protocol

from numpy.typing import ArrayLike

from trackslip.kinematics import Array


class Reference(Protocol):
    """A trajectory. It rests at its start before time 0 and at its end after `duration`."""

    @property
    def duration(self) -> float:
        """Time at which the reference ends [s]."""

    def pose(self, time: ArrayLike) -> Array:
        """Poses (..., 3) at times (...) [s]; phi unwrapped."""

    def twist(self, time: ArrayLike) -> Array:
        """Twists (..., 2) at times (...) [s]."""
