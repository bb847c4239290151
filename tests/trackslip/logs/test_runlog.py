"""Runs cut into parts."""

import numpy as np
import pytest

from trackslip.logs.runlog import RunLog


def log(duration):
    time = 3.0 + np.arange(round(duration / 0.1) + 1) * 0.1
    return RunLog("drive", time, np.ones((len(time), 2)), np.zeros((len(time), 3)), gyro=time)


@pytest.mark.parametrize(("duration", "count"), [(65.0, 10), (68.0, 10), (9.9, 2), (9.7, 1)])
def test_a_long_run_is_cut_into_parts_of_equal_duration(duration, count):
    whole = log(duration)
    parts = whole.cut(6.5)
    assert len(parts) == count
    np.testing.assert_array_equal(np.concatenate([part.time for part in parts]), whole.time)
    np.testing.assert_array_equal(np.concatenate([part.gyro for part in parts]), whole.gyro)
    assert np.ptp([part.time[-1] - part.time[0] for part in parts]) < 0.21
    assert len({part.run for part in parts}) == count


def test_a_short_run_stays_as_it_is():
    short = log(2.0)
    assert short.cut(6.5) == [short]
