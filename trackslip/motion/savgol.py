"""Savitzky and Golay's filter: a polynomial fitted to the window around each row, its value and its slope there.

As SciPy's `savgol_filter`, the ends too, but value and slope at once and without `scipy.signal`, whose import takes
longer than everything else that a recording needs.
"""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array


def savgol(values: Array, window: int, degree: int, step: float) -> tuple[Array, Array]:
    """Smooth values (T, n) and their derivatives (T, n), at the ends those of the first and the last whole window.

    Args:
        values: at even times (T, n).
        window: rows that each polynomial is fitted to: odd, more than `degree`, at most T.
        degree: of the polynomials, at least 1.
        step: between rows [s].
    """
    half = window // 2
    place = np.arange(-half, half + 1) / half  # in units of half a window
    powers = np.vander(place, degree + 1, increasing=True)  # (W, degree + 1)
    slopes = np.arange(1, degree + 1) * powers[:, :-1]  # of all powers but the constant
    fit = np.linalg.pinv(powers)  # (degree + 1, W)
    windows = np.lib.stride_tricks.sliding_window_view(values, window, axis=0)  # (T - W + 1, n, W)
    first, last = fit @ values[:window], fit @ values[-window:]
    before, after = slice(None, half), slice(half + 1, None)
    smooth = [powers[before] @ first, windows @ fit[0], powers[after] @ last]
    slope = [slopes[before] @ first[1:], windows @ fit[1], slopes[after] @ last[1:]]
    return np.concatenate(smooth), np.concatenate(slope) / (half * step)
