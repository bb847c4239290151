"""The table of samples that `bench --pipeline` identifies, and its checks."""

import numpy as np
import pytest

from experiments.speed.pipeline.laws import measure, table


def test_the_table_is_that_of_a_robot_that_does_everything():
    samples = table(270, np.random.default_rng(0)).samples
    left, right = samples.omega.T
    assert len(samples) == 270
    assert (left == right).sum() > 10
    assert (left == -right).sum() > 10
    assert ((left < 0) & (right < 0)).any()
    np.testing.assert_array_equal(samples.twist, table(270, np.random.default_rng(0)).samples.twist)


@pytest.mark.slow
def test_times_are_checked_against_their_bounds():
    seen = []
    checks = measure(0, 1, seen.append)
    assert seen == ["laws"]
    assert [(one.case, one.unit) for one in checks] == [
        ("laws of 25 runs", "s"),
        ("laws of 25 runs", "x"),
        ("laws of 270 samples", "s"),
        ("laws of 2000 samples", "s"),
    ]
    assert all(one.value > 0 for one in checks)
