import numpy as np
import pytest

from trackslip.motion.steady_twist import long_run_covariance


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 1.0])
def test_long_run_covariance_is_that_of_newey_and_west(share):
    series = np.cumsum(np.random.default_rng(0).standard_normal((60, 3)), axis=0)
    series -= series.mean(axis=0)
    lags = int(share * 60)
    expected = series.T @ series
    for lag in range(1, min(lags, 59) + 1):
        product = series[lag:].T @ series[:-lag]
        expected += (1 - lag / (lags + 1)) * (product + product.T)
    np.testing.assert_allclose(long_run_covariance(series, share), expected / 60, rtol=1e-12, atol=1e-12 * 60)


def test_by_default_the_width_follows_the_memory_of_the_series():
    rng = np.random.default_rng(1)
    noise = rng.standard_normal((4000, 1))
    slow = noise.copy()
    for k in range(1, len(slow)):
        slow[k] += 0.8 * slow[k - 1]
    assert long_run_covariance(noise)[0, 0] == pytest.approx(1.0, rel=0.2)
    assert long_run_covariance(slow)[0, 0] == pytest.approx(1 / (1 - 0.8) ** 2, rel=0.3)
