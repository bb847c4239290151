"""Straight ahead on ground that shears: the closed form of Janosi and Hanamoto, and its inverse."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import InvalidValueError, require_positive
from trackslip.kinematics import Array

_HALVINGS = 200


def straight_share(slip: ArrayLike, length: float, shear: float) -> Array:
    """Traction (...) over the friction limit at slips i (...) [-] of a track of a contact `length` [m].

    1 - K / (i L) (1 - exp(-i L / K)), with the shear modulus K = `shear` [m]; negative for a braking track.
    """
    require_positive("length", length)
    require_positive("shear", shear)
    ratio = np.asarray(slip, float) * length / shear
    size = np.maximum(np.abs(ratio), 1e-9)  # below it the share is ratio / 2 to the last digit but seven
    return np.sign(ratio) * np.where(size > 1e-4, 1 + np.expm1(-size) / size, size / 2 - size**2 / 6)


def straight_slip(share: ArrayLike, length: float, shear: float) -> Array:
    """Slips (...) [-] at which a track exerts tractions (...) over the friction limit; the inverse of `straight_share`.

    Raises InvalidValueError for a traction at or beyond the limit.
    """
    share = np.asarray(share, float)
    if not (np.abs(share) < 1).all():
        raise InvalidValueError("share", share.tolist(), "between -1 and 1: the ground exerts no more")
    size = np.abs(share)
    low, high = np.zeros_like(size), shear / length / (1 - size)  # 1 - 1 / ratio is a lower bound of the share
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        enough = straight_share(middle, length, shear) >= size
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    return np.sign(share) * high
