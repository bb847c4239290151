import numpy as np
import pytest
import scipy

from trackslip.motion import butterworth

LOW_PASS = scipy.signal.butter(2, 0.5, output="sos")


@pytest.fixture(params=[10, 17, 400])
def values(request):
    return 5 + np.cumsum(np.random.default_rng(0).normal(size=(request.param, 3)), axis=0)


def test_forwards_it_is_scipys_filter_settled_at_the_first_row(values):
    settled = scipy.signal.sosfilt_zi(LOW_PASS)[..., None] * values[0]
    expected, _ = scipy.signal.sosfilt(LOW_PASS, values, axis=0, zi=settled)
    np.testing.assert_allclose(butterworth.forwards(values), expected, rtol=1e-12)


def test_both_ways_it_is_scipys_filter(values):
    expected = scipy.signal.sosfiltfilt(LOW_PASS, values, axis=0)
    np.testing.assert_allclose(butterworth.both_ways(values), expected, rtol=1e-12)


def test_half_of_the_power_passes_at_half_of_the_highest_frequency():
    time = np.arange(2000)
    wave = np.cos(np.pi / 2 * time)[:, None]
    passed = butterworth.forwards(wave)[1000:]
    assert passed.std() / wave[1000:].std() == pytest.approx(np.sqrt(0.5), rel=1e-6)
