"""Where the plate sits on the robot, from how it moves when the sprockets turn, without the robot's geometry.

Driven straight, the plate moves along the robot's axis: that is its angle. Turned on the spot, each point of the robot
moves at right angles to its lever: that is its place. Both take the tracks to slip alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from trackslip import se2
from trackslip.kinematics import Array
from trackslip.rangefinder.plate_motion import PlateMotion, plate_motion

_BLOCKS = 12  # of the session, each of which is left out once
_DETERMINED = {"x": 0.05, "y": 0.05, "yaw": 0.05}  # largest standard error of a value that is told [m, m, rad]
_MIN_UNLIKE = 0.05  # share of the driving with another ratio of the sprockets' speeds than the rest [-]
_MIN_TURN = 1e-6  # of the plate per radian of the sprockets [-]


@dataclass(frozen=True)
class PlatePlace:
    """Place and angle of the plate on the robot."""

    x: float
    """Its centre, ahead of the turning centre [m]."""
    y: float
    """Its centre, to the left of the middle of the tracks [m]."""
    yaw: float
    """Its heading on the robot, counter-clockwise [rad]."""
    stderr: dict[str, float]
    """Standard errors of those that the driving determines; the others are 0."""


def plate_place(time: Array, angle: Array, pose: Array) -> PlatePlace | None:
    """The place that follows from poses (n, 3) at times (n,), the sprockets turned by angles (n, 2) [rad].

    Standard errors are the jackknife's: the session cut into blocks, each left out once. None if nothing is told.
    """
    spans = np.linalg.svd(np.diff(angle, axis=0), compute_uv=False)
    motion = plate_motion(time, angle, pose, free=True) if spans[1] > _MIN_UNLIKE * spans[0] else None
    found = None if motion is None else _place(motion)
    if found is None:
        return None
    edges = np.linspace(0, len(time), _BLOCKS + 1).astype(int)
    others = []
    for begin, end in pairwise(edges):
        rest = np.r_[0:begin, end : len(time)]
        without = plate_motion(time[rest], angle[rest], pose[rest], free=True)
        one = None if without is None else _place(without)
        if one is not None:
            others.append(one)
    if len(others) < _BLOCKS:
        return None
    scatter = np.array(others) - np.mean(others, axis=0)
    errors = np.sqrt((_BLOCKS - 1) / _BLOCKS * np.sum(scatter**2, axis=0))
    told = {name: float(error) for name, error in zip(_DETERMINED, errors, strict=True) if error < _DETERMINED[name]}
    x, y, yaw = (float(value) if name in told else 0.0 for name, value in zip(_DETERMINED, found, strict=True))
    return PlatePlace(x, y, yaw, told) if told else None


def _place(motion: PlateMotion) -> Array | None:
    """Place and angle (3,); None if the plate doesn't turn or goes ahead only backwards."""
    straight, spin = motion.matrix @ np.array([1.0, 1.0]), motion.matrix @ np.array([-1.0, 1.0])
    if abs(spin[2]) < _MIN_TURN or straight[0] <= 0:
        return None
    yaw = -np.arctan2(straight[1], straight[0])
    ahead, aside = se2.rotate(yaw, spin[:2] / spin[2])  # in the robot's frame
    return np.array([aside, -ahead, yaw])
