import numpy as np
import pytest

from trackslip.trajectory.named import load_reference
from trackslip.trajectory.tabulated import Tabulated

PERIOD = 0.05


@pytest.mark.parametrize("name", ["paper", "figure_eight", "slalom", "stop_and_go"])
def test_the_table_is_the_reference(name):
    reference = load_reference(name)
    times = np.arange(np.ceil(reference.duration / PERIOD) + 1) * PERIOD
    tabulated = Tabulated(reference, times)
    assert tabulated.duration == reference.duration
    for time in [*times[::37].tolist(), float(times[-1])]:  # up to the rounding of sums in vector registers
        np.testing.assert_allclose(tabulated.pose(time), reference.pose(time), rtol=1e-14, atol=1e-15)
        np.testing.assert_allclose(tabulated.twist(time), reference.twist(time), rtol=1e-14, atol=1e-15)
    tabulated.pose(float(times[1]))[:] = 7.0  # what a caller does to its pose is its own affair
    np.testing.assert_allclose(tabulated.pose(float(times[1])), reference.pose(float(times[1])), rtol=1e-14, atol=1e-15)
    for time in (-1.0, 0.0123, float(times[1]) + 1e-9, times[:5]):
        np.testing.assert_array_equal(tabulated.pose(time), reference.pose(time))
        np.testing.assert_array_equal(tabulated.twist(time), reference.twist(time))
