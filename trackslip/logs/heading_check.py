"""Checks that headings are in radians and counter-clockwise: a robot moves along its heading, so its path shows it."""

from __future__ import annotations

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array

_STRIDE = 0.5  # time over which a direction is estimated [s]
_MIN_WAY = 0.01  # distance whose direction is well above the noise [m]
_MIN_STEPS = 5  # minimum number of directions
_MANY_STEPS = 30  # number of directions that make chance agreement unlikely
_AGREES, _DISAGREES = 0.9, 0.5  # mean resultant length of the residuals of right and of wrong headings
_AGREE_MANY = 0.6  # the same of right headings, out of many noisy ones


def require_headings(time: Array, pose: Array, run: str) -> None:
    """Raise LogError if the headings of measured poses (T, 3) only fit the path as degrees or clockwise.

    The chord between two poses has the heading of the pose half-way in time. Runs that turn in place have no such path
    and pass.
    """
    if len(time) < 5:
        return
    half = min(max(1, round(_STRIDE / 2 / float(np.median(np.diff(time))))), (len(time) - 1) // 2)
    way = pose[2 * half :, :2] - pose[: -2 * half, :2]
    length = np.hypot(*way.T)
    moved = (length > _MIN_WAY) & (length >= np.median(length))  # noise matters least in the longer half
    if moved.sum() < _MIN_STEPS:
        return
    direction, heading = np.arctan2(way[moved, 1], way[moved, 0]), pose[half:-half, 2][moved]

    def agreement(values: Array) -> float:
        return float(np.abs(np.mean(np.exp(2j * (direction - values)))))  # doubled: robots reverse, too

    if agreement(heading) >= _DISAGREES:
        return
    agrees = _AGREES if moved.sum() < _MANY_STEPS else _AGREE_MANY
    if agreement(np.radians(heading)) > agrees:
        raise LogError(f"run {run!r}: column phi: headings fit the path in degrees, must be in radians")
    if agreement(-heading) > agrees:
        raise LogError(
            f"run {run!r}: column phi: headings fit the path clockwise, must be counter-clockwise from x to y: "
            "are they a compass's, or x and y swapped?"
        )
