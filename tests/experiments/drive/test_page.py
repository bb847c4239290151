"""The figures of a drive over a course."""

import numpy as np
import pytest

from experiments.drive.page import slip_limits


@pytest.mark.parametrize(
    ("slip", "least", "most"), [(np.full((500, 2), 0.01), 0.0, 0.1), (np.linspace(-3, 3, 500)[:, None], 1.4, 1.5)]
)
def test_the_axis_of_slips_is_as_wide_as_the_slips_within_limits(slip, least, most):
    low, high = slip_limits(slip)
    assert least <= high - low <= most
    assert low < np.median(slip) < high


def test_an_axis_of_no_slips_has_limits():
    low, high = slip_limits(np.full((3, 2), np.nan))
    assert low < 0 < high
