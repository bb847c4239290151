"""Modes of the two tracks, mean and half the difference, to which the ground responds nearly independently."""

import numpy as np

from trackslip.kinematics import Array

COMMON = 25.0
"""First guess of the response to a change on both tracks, which accelerates the robot: torque over mass, radius squared
and speed [1/s]."""
OPPOSITE = 12_000.0
"""The same for opposite changes: friction holds the heading until the tracks slide [1/s]."""


def modes(tracks: Array) -> Array:
    """Mean and half the difference (N, 2) of the (left, right) tracks (N, 2)."""
    left, right = tracks.T
    return np.stack([left + right, right - left], axis=-1) / 2


def tracks(modes: Array) -> Array:
    """The inverse of `modes`."""
    mean, difference = modes.T
    return np.stack([mean - difference, mean + difference], axis=-1)
