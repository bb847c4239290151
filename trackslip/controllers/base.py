"""The protocol of path-tracking controllers."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from numpy.typing import ArrayLike

from trackslip.kinematics import Array
from trackslip.trajectory.base import Reference


class Controller(Protocol):
    """Converts a pose into the body twist to drive. It does not handle slip: see `SlipLaw` and `compensation`.

    A controller is given the poses of any number of robots at once, so any state it has is per robot.
    """

    def reset(self) -> None:
        """Discard the state, because a new run begins."""

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) to drive at `time` [s] from measured poses (..., 3)."""


@runtime_checkable
class SensesSprockets(Protocol):
    """A controller that also uses the sprocket speeds."""

    def sense(self, omega: Array) -> None:
        """Take the sprocket speeds (N, 2) [rad/s] measured over the last period; called before `twist`."""
