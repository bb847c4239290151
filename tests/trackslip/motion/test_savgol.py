import numpy as np
import pytest
from scipy.signal import savgol_filter

from trackslip.motion.savgol import savgol


@pytest.mark.parametrize(("rows", "window", "degree"), [(200, 59, 4), (16, 15, 4), (30, 7, 2)])
def test_it_is_scipys(rows, window, degree):
    values = np.random.default_rng(1).normal(size=(rows, 3)).cumsum(axis=0)
    smooth, slope = savgol(values, window, degree, 0.05)
    np.testing.assert_allclose(smooth, savgol_filter(values, window, degree, axis=0), atol=1e-10)
    expected = savgol_filter(values, window, degree, deriv=1, delta=0.05, axis=0)
    np.testing.assert_allclose(slope, expected, atol=1e-9)


def test_it_leaves_a_polynomial_and_its_slope_as_they_are():
    time = 0.1 * np.arange(40)
    cubic = np.polynomial.Polynomial([1.0, -2.0, 0.5, 0.1])
    smooth, slope = savgol(cubic(time)[:, None], 11, 3, 0.1)
    np.testing.assert_allclose(smooth[:, 0], cubic(time), atol=1e-11)
    np.testing.assert_allclose(slope[:, 0], cubic.deriv()(time), atol=1e-11)
