"""The traction that robots need, as an inclinometer and a load cell at the hitch would tell."""

from __future__ import annotations

import numpy as np

from sim.fleet import Fleet
from trackslip.kinematics import Array


def needed_traction(fleet: Fleet) -> Array:
    """Tractions (N, 2) along the robots and to their left, over their normal force, at a constant velocity [-]."""
    direction = fleet.footing.uphill - fleet.pose()[:, 2]
    steepness = np.tan(fleet.footing.slope)
    needed = np.empty((fleet.size, 2))
    needed[:, 0] = steepness * np.cos(direction) + fleet.towed(np.arange(fleet.size))
    needed[:, 1] = steepness * np.sin(direction)
    return needed
