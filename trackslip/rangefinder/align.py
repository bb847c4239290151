"""The scanner's mounting from poses measured at the same time by another sensor, such as SLAM or motion capture.

With positions as complex numbers, q of the other sensor in its frame and p of the plate in the scanner's, the mounting
m at the angle mu, and the other sensor at the place l on the plate,

    q = m + exp(i mu) (p + exp(i theta) l)

where theta is the plate's heading. That is linear in m, a = exp(i mu) and a l; the size of a compares the scales.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.motion.steady_twist import long_run_covariance

_MIN_POSES = 20
_MIN_EXTENT = 0.3  # of the way, from which the mounting's angle follows [m]
_ROUNDS = 20
_HUBER = 2.0  # residual above which the loss is linear [robust standard deviations]
_MAX_GAP = 0.5  # between poses of the other source, over which they are interpolated [s]
_MIN_CONDITION = 1e-6  # of the normal equations, below which the lever is not determined


@dataclass(frozen=True)
class Alignment:
    """Mounting of a scanner in another frame."""

    mount: Array  # (3,) pose of the scanner [m, m, rad]
    stderr: Array  # (3,) its standard errors, which allow for errors that last
    scale: float
    """Length by the other source over that by the scanner [-]."""
    scale_stderr: float
    residual: float
    """Root mean square distance of the other source's positions from those that follow from the scans [m]."""


def mounting(time: Array, pose: Array, other_time: Array, other: Array) -> Alignment:
    """The mounting that leads from the plate's poses (n, 3) in the scanner's frame to positions of the robot elsewhere.

    Args:
        time: of the poses (n,), ascending [s].
        pose: of the plate in the scanner's frame (n, 3) [m, m, rad].
        other_time: of the other source's positions (m,), ascending, by the same clock [s].
        other: its positions (m, 2) of any point of the robot [m].

    Raises:
        LogError: if too few poses are at the same time, or the robot hardly moves.
    """
    after = np.clip(np.searchsorted(other_time, time), 1, len(other_time) - 1)
    inside = (time >= other_time[0]) & (time <= other_time[-1])
    shared = inside & (other_time[after] - other_time[after - 1] < _MAX_GAP)
    if shared.sum() < _MIN_POSES:
        what = f"{int(shared.sum())} poses from scans are at times of the other poses"
        raise LogError(f"{what}, needs at least {_MIN_POSES}: the mounting isn't determined")
    q = np.interp(time[shared], other_time, other[:, 0]) + 1j * np.interp(time[shared], other_time, other[:, 1])
    p, turned = pose[shared, 0] + 1j * pose[shared, 1], np.exp(1j * pose[shared, 2])
    extent = float(max(np.ptp(p.real), np.ptp(p.imag)))
    if extent < _MIN_EXTENT:
        raise LogError(f"the robot stays within {extent:.2g} m: the scanner's mounting isn't determined")
    middle = p.mean()
    design = np.column_stack([np.ones(len(p)), p - middle, turned])
    found, weight = _robust(design, q)
    residual = q - design @ found
    covariance = _covariance(design, weight * residual, weight)
    slope = found[1] / abs(found[1])
    origin = found[0] - slope * middle
    turn_error = float(np.sqrt(covariance[1] / 2) / abs(found[1]))
    swing = slope * middle * turn_error  # of the origin about the middle, at right angles to this
    place_error = np.sqrt(covariance[0] / 2 + np.array([swing.imag, swing.real]) ** 2)
    return Alignment(
        np.array([origin.real, origin.imag, float(np.angle(slope))]),
        np.append(place_error, turn_error),
        float(abs(found[1])),
        turn_error * float(abs(found[1])),
        float(np.sqrt(np.mean(np.abs(residual) ** 2))),
    )


def _robust(design: Array, q: Array) -> tuple[Array, Array]:
    """Complex coefficients (3,) under a Huber loss, and the weights (n,)."""
    weight = np.ones(len(q))
    found = np.zeros(3, complex)
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)
        found = np.linalg.lstsq(design * root[:, None], q * root, rcond=_MIN_CONDITION)[0]
        size = np.abs(q - design @ found)
        scale = max(float(np.median(size)), 1e-9)
        weight = np.minimum(1.0, _HUBER * scale / np.maximum(size, 1e-12))
    return found, weight


def _covariance(design: Array, residual: Array, weight: Array) -> Array:
    """Variances (3,) of the complex coefficients, from scores (n,) that may be correlated in time."""
    bread = np.linalg.pinv((design.conj().T * weight) @ design, rcond=_MIN_CONDITION, hermitian=True)
    scores = design.conj() * residual[:, None]
    both = np.column_stack([scores.real, scores.imag])
    joint = len(residual) * long_run_covariance(both)
    k = design.shape[1]
    meat = joint[:k, :k] + joint[k:, k:] + 1j * (joint[k:, :k] - joint[:k, k:])
    return np.real(np.einsum("ij,jk,ik->i", bread, meat, bread.conj()))
