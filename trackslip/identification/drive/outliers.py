"""Outlying poses, which jump away and back, and lasting jumps, after which the poses continue elsewhere."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from trackslip.kinematics import Array, wrap_angle

_NEIGHBOURS = 7  # poses that predict the next one
_FAR = 6.0  # outlying error of prediction [robust standard deviations]
_MIN_SPREAD = np.array([1e-3, np.radians(0.05)])  # [m, rad]


def outlying(pose: Array, state: Array, motion: Array) -> tuple[np.ndarray, np.ndarray]:
    """Outlying poses (n,) bool, and poses after lasting jumps (n,) bool, of one drive.

    Each pose is predicted from its neighbours before, and from those after it: the median of where dead reckoning from
    each leads. An outlying pose misses both predictions, the first one after a lasting jump only the prediction from
    before.

    Args:
        pose: (n, 3) measured poses; NaN headings are not compared.
        state: (n, 3) positions and headings to reckon from.
        motion: (n, 3) path of dead reckoning from anywhere.
    """
    before, after = _far(pose, state, motion)
    bad = before & after
    kept = np.flatnonzero(~bad)  # an outlying pose beside a jump would hide it
    before, after = _far(pose[kept], state[kept], motion[kept])
    lasting = np.zeros(len(pose), bool)
    lasting[kept[1:]] = before[1:] & ~after[1:] & after[:-1] & ~before[:-1]
    return bad, lasting


def _far(pose: Array, state: Array, motion: Array) -> tuple[np.ndarray, np.ndarray]:
    """Poses (n,) bool that those before them mispredict far, and poses that those after them do."""
    before = _missed(pose, state, motion)
    after = _missed(pose[::-1], state[::-1], motion[::-1])[::-1]
    known = np.isfinite(before + after)
    usual = [
        np.median(np.minimum(a, b)[k]) if k.any() else 0.0 for a, b, k in zip(before.T, after.T, known.T, strict=True)
    ]
    far = _FAR * np.maximum(1.4826 * np.array(usual), _MIN_SPREAD)
    return (np.nan_to_num(before) > far).any(axis=1), (np.nan_to_num(after) > far).any(axis=1)


def _missed(pose: Array, state: Array, motion: Array) -> Array:
    """Errors (n, 2) of position and heading of each pose as predicted by the median of those before it."""
    count = len(pose)
    size = min(_NEIGHBOURS, count - 1)
    errors = np.full((count, 2), np.nan)
    if size < 1:
        return errors
    rows = np.arange(size, count)
    window = sliding_window_view(np.arange(count), size)[:-1]  # (n - size, size) indices of the poses before
    z, c = pose[:, 0] + 1j * pose[:, 1], motion[:, 0] + 1j * motion[:, 1]
    turned = np.exp(1j * (state[:, 2] - motion[:, 2]))
    predicted = z[window] + turned[window] * (c[rows, None] - c[window])
    middle = np.median(predicted.real, axis=1) + 1j * np.median(predicted.imag, axis=1)
    errors[rows, 0] = np.abs(z[rows] - middle)
    heading = wrap_angle(pose[window, 2] + motion[rows, None, 2] - motion[window, 2] - pose[rows, None, 2])
    errors[rows, 1] = np.abs(np.median(heading, axis=1))
    return errors
