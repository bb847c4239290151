"""The traction that robots need, as an inclinometer and a load cell at the hitch would tell."""

from __future__ import annotations

import numpy as np

from sim.fleet import Fleet
from trackslip.kinematics import Array


def needed_traction(fleet: Fleet) -> Array:
    """Tractions (N, 2) along the robots and to their left, over their normal force, at a constant velocity [-]."""
    slope = np.array([ground.slope for ground in fleet.ground])
    uphill = np.array([ground.uphill for ground in fleet.ground])
    direction = uphill - fleet.pose()[:, 2]
    along = np.tan(slope) * np.cos(direction) + fleet.towed(np.arange(fleet.size))
    return np.column_stack([along, np.tan(slope) * np.sin(direction)])
