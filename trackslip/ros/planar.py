"""Poses in space, seen from above: headings of quaternions, meaningful covariances of x, y and heading."""

from __future__ import annotations

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array

_MAX_TILT = np.radians(20.0)  # of a robot, above which its heading and way in the plane are doubtful [rad]
_TOLERANCE = 0.02  # by which a quaternion's norm may differ from 1
_MOST = 0.5  # share of quaternions without meaning above which poses can't be read
_PLANE = [0, 1, 5]  # x, y and yaw out of x, y, z, roll, pitch, yaw
_MIN_VARIANCE = 1e-30  # smaller ones, too
_MAX_VARIANCE = np.array([1e3, 1e3, 10.0])  # of x, y [m^2] and heading [rad^2]: larger ones stand for "unknown"


def unit_quaternions(quaternion: Array, source: str, notes: list[str]) -> np.ndarray:
    """(n,) bool: which quaternions x, y, z, w (n, 4) are of unit length; raises LogError if most are not."""
    with np.errstate(over="ignore", invalid="ignore"):
        good = np.abs(np.linalg.norm(quaternion, axis=1) - 1.0) <= _TOLERANCE
    bad = int((~good).sum())
    if bad:
        shown = np.array2string(quaternion[np.argmin(good)], precision=4)
        line = f"the quaternion {shown} is not of unit length"
        if bad > _MOST * len(good):
            raise LogError(f"{source}: {line}; so are {bad} of its {len(good)} quaternions")
        notes.append(f"{source}: {bad} of {len(good)} poses left out: {line}")
    return np.asarray(good)


def headings(quaternion: Array, source: str, notes: list[str]) -> Array:
    """Headings (n,) of the x axes of rotations (n, 4), counter-clockwise from above [rad].

    NaN if most of them are tilted so much that the x axis shows no heading. `notes` gets a line for tilts above 20°.
    """
    x, y, z, w = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    heading = np.arctan2(2 * (x * y + z * w), 1 - 2 * (y * y + z * z))
    tilt = np.arccos(np.clip(1 - 2 * (x * x + y * y), -1.0, 1.0))
    steep = tilt > _MAX_TILT
    if not steep.any():
        return np.asarray(heading)
    most = f"{np.degrees(tilt.max()):.0f}°"
    tilted = f"tilted by more than 20° in {int(steep.sum())} of {len(tilt)} poses, by up to {most}"
    if steep.mean() <= _MOST:
        notes.append(f"{source}: {tilted}: slip is identified in the plane")
        return np.asarray(heading)
    notes.append(f"{source}: its frame is {tilted}: headings left out; is it a camera's frame, or has it z downwards?")
    return np.full(len(heading), np.nan)


def planar_covariances(stated: Array) -> Array:
    """Covariances (n, 3, 3) of x, y and heading out of those (n, 36) of poses in space."""
    return np.asarray(stated.reshape(-1, 6, 6)[:, _PLANE][:, :, _PLANE])


def knows_heading(covariance: Array) -> bool:
    """True if any of the covariances (n, 3, 3) states a known heading."""
    return not (covariance[:, 2, 2] > _MAX_VARIANCE[2]).all()


def meaningful_covariances(covariance: Array, heading: bool) -> Array | None:
    """The covariances (n, 3, 3), NaN where zero or absurd; None if none means anything.

    Absurd are those that aren't finite, symmetric and positive, and those that stand for "unknown". Without `heading`,
    its entries are NaN and don't count.
    """
    size = 3 if heading else 2
    part = covariance[:, :size, :size]
    variance = np.einsum("nii->ni", part)
    good = np.isfinite(part).all(axis=(1, 2))
    good &= ((variance >= _MIN_VARIANCE) & (variance <= _MAX_VARIANCE[:size])).all(axis=1)
    good &= (np.abs(part) <= _MAX_VARIANCE.max()).all(axis=(1, 2))
    tame = np.where(good[:, None, None], part, np.eye(size))
    scale = np.sqrt(np.einsum("nii->ni", tame))
    correlation = tame / (scale[:, :, None] * scale[:, None, :])
    good &= np.abs(correlation - correlation.swapaxes(1, 2)).max(axis=(1, 2)) < 1e-6
    good &= np.linalg.eigvalsh((correlation + correlation.swapaxes(1, 2)) / 2)[:, 0] > -1e-9
    if not good.any():
        return None
    kept = np.full_like(covariance, np.nan)
    kept[good, :size, :size] = part[good]
    return kept
