"""Headings from quaternions."""

from __future__ import annotations

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array

MAX_TILT = np.radians(20.0)
"""Tilt of a robot above which its heading and way in the plane are doubtful [rad]."""
_TOLERANCE = 0.02  # by which a quaternion's norm may differ from 1
_MOST = 0.5  # share of quaternions without meaning above which poses can't be read


def usable(quaternion: Array, source: str, notes: list[str]) -> np.ndarray:
    """(n,) bool: which quaternions x, y, z, w (n, 4) are of unit length; raises LogError if most are not."""
    norm = np.linalg.norm(quaternion, axis=1)
    good = np.abs(norm - 1.0) <= _TOLERANCE
    bad = int((~good).sum())
    if bad:
        k = int(np.argmin(good))
        line = f"the quaternion {np.array2string(quaternion[k], precision=4)} is not of unit length"
        if bad > _MOST * len(good):
            raise LogError(f"{source}: {line}; so are {bad} of its {len(good)} quaternions")
        notes.append(f"{source}: {bad} of {len(good)} poses left out: {line}")
    return np.asarray(good)


def headings(quaternion: Array, source: str, notes: list[str]) -> Array:
    """Headings (n,) of the x axes of rotations (n, 4), counter-clockwise from above [rad].

    NaN if most of them are tilted so much that the x axis shows no heading. Tilts beyond MAX_TILT are noted.
    """
    x, y, z, w = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    heading = np.arctan2(2 * (x * y + z * w), 1 - 2 * (y * y + z * z))
    tilt = np.arccos(np.clip(1 - 2 * (x * x + y * y), -1.0, 1.0))
    steep = tilt > MAX_TILT
    if not steep.any():
        return np.asarray(heading)
    most = f"by up to {np.degrees(tilt.max()):.0f}°"
    if steep.mean() > _MOST:
        notes.append(
            f"{source}: its frame is tilted by more than 20° in {int(steep.sum())} of {len(tilt)} poses, {most}: "
            "headings left out; is it a camera's frame, or has it z downwards?"
        )
        return np.full(len(heading), np.nan)
    notes.append(
        f"{source}: tilted by more than 20° in {int(steep.sum())} of {len(tilt)} poses, {most}: "
        "slip is identified in the plane"
    )
    return np.asarray(heading)
