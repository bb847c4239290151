"""What a path-tracking controller is."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from numpy.typing import ArrayLike

from trackslip.kinematics import Array
from trackslip.trajectory.base import Reference


class Controller(Protocol):
    """Turns a pose into the body twist to drive. Slip is none of its business: see `slip.SlipLaw`.

    A controller takes the poses of any number of robots at once, so state is kept per robot, if at all.
    """

    def reset(self) -> None:
        """Forget the past: a new run begins."""
        ...

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) to drive at `time` [s] from measured poses (..., 3)."""
        ...


@runtime_checkable
class SensesSprockets(Protocol):
    """A controller that also wants to know how fast the sprockets turn."""

    def sense(self, omega: Array) -> None:
        """Sprocket speeds (N, 2) [rad/s], as the encoders counted them over the last period, before `twist`."""
        ...
