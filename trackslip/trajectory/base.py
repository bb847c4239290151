"""The protocol of references."""

from __future__ import annotations

from typing import Protocol

from numpy.typing import ArrayLike

from trackslip.kinematics import Array


class Reference(Protocol):
    """A path in time. Before 0 it stands at its start, after `duration` at its end."""

    @property
    def duration(self) -> float:
        """When the reference stops [s]."""
        ...

    def pose(self, time: ArrayLike) -> Array:
        """Poses (..., 3) at times (...) [s]; phi unwrapped."""
        ...

    def twist(self, time: ArrayLike) -> Array:
        """Twists (..., 2) at times (...) [s]."""
        ...
