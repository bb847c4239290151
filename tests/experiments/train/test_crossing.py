"""Shares of courses crossed, and their confidence intervals."""

import numpy as np
import pytest

from experiments.train.crossing import POLICY, SCRIPTED, STRAIGHT, compare, crossing_gain, learning_curve
from sim.network import Network
from sim.terrain import Course, Flat
from sim.traverse.policy import OPTIONS, CrossingPolicy


def test_the_gain_is_that_of_the_pairs():
    scripted = np.arange(400) < 200
    policy = scripted ^ (np.arange(400) >= 320)  # 80 more, none fewer
    gain = crossing_gain("random", scripted, policy)
    assert (gain.gain, gain.only_policy, gain.only_scripted) == (0.2, 80, 0)
    # of a share of 0.2 among 400: normal, to two decimals
    half = 1.96 * np.sqrt(0.2 * 0.8 / 400)
    assert (gain.low, gain.high) == pytest.approx((0.2 - half, 0.2 + half), abs=4e-3)


def test_two_controllers_that_cross_the_same_few_courses_may_still_differ():
    every = np.ones(24, bool)
    gain = crossing_gain("steps_down", every, every)
    assert (gain.gain, gain.low, gain.high) == (0, pytest.approx(-0.0754, abs=1e-4), pytest.approx(0.0754, abs=1e-4))
    assert crossing_gain("steps_up", ~every, every).high == 1.0


def test_intervals_of_the_gain_cover_the_truth():
    rng = np.random.default_rng(1)
    covered = 0
    for _ in range(60):
        scripted = rng.random(150) < 0.6
        policy = np.where(rng.random(150) < 0.3, rng.random(150) < 0.9, scripted)  # true gain 0.3 (0.9 - 0.6)
        gain = crossing_gain("random", scripted, policy)
        covered += gain.low <= 0.09 <= gain.high
    assert 52 <= covered < 60  # of 60, 57 expected


def test_a_policy_that_corrects_nothing_crosses_what_the_scripted_controller_does():
    short = Course((Flat(0.1),), start_length=0.4, goal_length=0.4)
    still = CrossingPolicy(Network((np.zeros((63, 4)),), (np.zeros(4),)), OPTIONS | {"course": short})
    rates, (gain,) = compare(still, (0.1, 0.1), 2, seed=0, threads=1)
    everyone = (SCRIPTED, POLICY, *STRAIGHT)
    assert [(one.course, one.controller, one.courses, one.crossed) for one in rates] == [
        ("own", controller, 2, 2) for controller in everyone
    ]
    assert rates[0].time == rates[1].time
    assert (rates[0].low, rates[0].high) == pytest.approx((0.342, 1.0), abs=1e-3)  # Wilson, two of two
    assert (gain.gain, gain.low) == (0.0, -gain.high)


def test_several_kinds_of_courses_have_a_row_per_controller_and_a_gain_each():
    still = CrossingPolicy(Network((np.zeros((63, 4)),), (np.zeros(4),)), OPTIONS | {"course": ["steps_down", "rails"]})
    rates, gains = compare(still, (0.0, 0.2), 2, seed=0, threads=1)
    assert [one.course for one in rates] == ["steps_down"] * 4 + ["rails"] * 4
    assert [gain.course for gain in gains] == ["steps_down", "rails"]
    found = {(one.course, one.controller): one.crossed for one in rates}
    assert found["steps_down", SCRIPTED] == found["steps_down", "straight, flat"] == 2
    assert found["rails", "straight, raised"] == 0  # tips of flippers in the air don't lift it over
    points = [{"steps": 1, "reward": 0.0, "crossed": 0.5}]
    (*_, axes) = learning_curve(points, rates).axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["steps_down", "rails"]
