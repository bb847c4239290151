"""Feedforward (Sec. IV-B): the twist of the reference, regardless of the pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.controllers.control_law import ControlLaw
from trackslip.kinematics import Array
from trackslip.trajectory.base import Reference


@dataclass(frozen=True)
class Feedforward(ControlLaw):
    """Drives the twist of the reference in open loop."""

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """The twist of the reference for each of the poses (..., 3), (..., 2)."""
        twist = np.empty((*np.shape(pose)[:-1], 2))
        twist[...] = reference.twist(time)
        return twist
