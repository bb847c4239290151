"""What is a robot's own in a run."""

from __future__ import annotations

from dataclasses import dataclass, field

from sim.drive.drive import RADIUS_ERROR, Drive
from sim.ground.ground import Ground


@dataclass(frozen=True)
class Setting:
    """How a robot's run begins, and what is its own in it."""

    start: tuple[float, float, float]
    """Pose [m, m, rad]."""
    ground: Ground = field(default_factory=Ground)
    radius_error: float = RADIUS_ERROR
    """Of the effective sprocket radius [-]."""
    lag: float = Drive.lag
    """Time constant of the servos [s]."""
    weight: tuple[float, float] = (0.0, 0.0)
    """Where the centre of mass is, forward and to the left of where the model has it [m]."""
