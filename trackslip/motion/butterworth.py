"""The paper's low-pass filter: Butterworth, of second order, that passes half of the frequencies a log can show.

    H(z) = b (1 + 1 / z)^2 / (1 + a / z^2)        b = 1 / (2 + sqrt 2)        a = (2 - sqrt 2) / (2 + sqrt 2)

Written out because `scipy.signal`, which takes longer to import than most logs to filter, is needed for nothing else.
"""

from __future__ import annotations

import math

import numpy as np
import scipy

from trackslip.kinematics import Array

_GAIN = 1 / (2 + math.sqrt(2))
_RECURSION = (2 - math.sqrt(2)) / (2 + math.sqrt(2))
_PADDING = 9  # rows by which values are continued at either end


def forwards(values: Array) -> Array:
    """Values (T, k) filtered, as if they had always been as in the first row."""
    change = np.concatenate([np.zeros((2, values.shape[1])), values - values[0]])
    driven = _GAIN * (change[2:] + 2 * change[1:-1] + change[:-2])
    bands = np.outer([1.0, 0.0, _RECURSION], np.ones(len(values)))
    smooth, _ = scipy.linalg.lapack.dtbtrs(bands, driven, uplo="L")
    return np.asarray(smooth + values[0])


def both_ways(values: Array) -> Array:
    """Values (T, k) filtered forwards and backwards, which delays nothing; T must exceed 9.

    At either end they are continued by their mirror image about the last point, as `scipy.signal.sosfiltfilt` does.
    """
    before, after = 2 * values[0] - values[_PADDING:0:-1], 2 * values[-1] - values[-2 : -_PADDING - 2 : -1]
    smooth = forwards(np.concatenate([before, values, after]))
    return forwards(smooth[::-1])[::-1][_PADDING:-_PADDING]
