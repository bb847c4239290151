import numpy as np
import pytest

from experiments.train.crossing import crossing_rates
from sim.policy import Network, Policy
from sim.terrain import Course, Flat
from sim.traverse.policy import OPTIONS

NO_CORRECTION = Network((np.zeros((63, 4)),), (np.zeros(4),))


def test_a_policy_without_corrections_crosses_as_if_scripted():
    short = Course((Flat(0.1),), start_length=0.4, goal_length=0.4)
    policy = Policy(NO_CORRECTION, OPTIONS | {"course": short})
    scripted, learned = crossing_rates(policy, (0.1, 0.1), 2, seed=0, threads=1)
    assert scripted["controller"] == "scripted"
    assert learned == scripted | {"controller": "policy"}
    assert scripted["course"] == "own"
    assert scripted["courses"] == 2
    assert scripted["crossed"] == 2
    # Wilson, two of two
    assert scripted["low"] == pytest.approx(0.342, abs=1e-3)
    assert scripted["high"] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.slow
def test_several_kinds_of_courses_have_a_row_for_each_controller():
    policy = Policy(NO_CORRECTION, OPTIONS | {"course": ["steps_down", "rails"]})
    rows = crossing_rates(policy, (0.0, 0.2), 2, seed=0, threads=1)
    assert [row["course"] for row in rows] == ["steps_down"] * 2 + ["rails"] * 2
    assert rows[0]["crossed"] == rows[1]["crossed"] == 2
