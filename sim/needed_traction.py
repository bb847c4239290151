"""The traction that robots need, as an inclinometer and a load cell at the hitch would tell."""

from __future__ import annotations

import numpy as np

from sim.fleet import Fleet
from trackslip.kinematics import Array


def needed_traction(fleet: Fleet) -> Array:
    """Traction (N,) that the robots need against slope and pull at a constant speed, over their normal force [-]."""
    slope = np.array([ground.slope for ground in fleet.ground])
    uphill = np.array([ground.uphill for ground in fleet.ground])
    return np.tan(slope) * np.cos(uphill - fleet.pose()[:, 2]) + fleet.towed(np.arange(fleet.size))
