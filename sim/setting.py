"""Setting: start and properties of one robot in one run."""

from __future__ import annotations

from dataclasses import dataclass, field

from sim.drive.drive import RADIUS_ERROR, Drive
from sim.ground.ground import Ground


@dataclass(frozen=True)
class Setting:
    """Start and properties of one robot in one run."""

    start: tuple[float, float, float]
    """Start pose (x, y, phi) [m, m, rad]."""
    ground: Ground = field(default_factory=Ground)
    """Ground under the robot."""
    radius_error: float = RADIUS_ERROR
    """Relative error of the effective sprocket radius, real / nominal - 1 [-]."""
    lag: float = Drive.lag
    """Time constant of the servos [s]."""
    weight: tuple[float, float] = (0.0, 0.0)
    """Offset of the centre of mass from the model's, forward and to the left [m]."""
