"""Robots that fall gain no energy and hardly bounce, whatever their size and mass."""

import numpy as np
import pytest

from experiments.validate.terrain.releases import LEAST_GAIN, random_robot, releases
from experiments.validate.terrain.subjects import FromFile


@pytest.mark.parametrize("preset", ["accurate", "fast"])
@pytest.mark.parametrize("count", [12, pytest.param(1000, marks=pytest.mark.slow)])
def test_random_robots(preset, count):
    found = releases(None, preset, np.random.default_rng(count), count)
    assert found.gain.max() <= LEAST_GAIN
    assert found.rebound.max() <= 0.25


@pytest.mark.parametrize("preset", ["accurate", "fast"])
def test_a_robot_with_flippers(preset):
    found = releases(FromFile("rescue"), preset, np.random.default_rng(0), 10)
    assert found.gain.max() <= LEAST_GAIN
    assert found.rebound.max() <= 0.25


def test_random_robots_cover_the_sizes():
    robots = [random_robot(np.random.default_rng(seed)) for seed in range(300)]
    lengths, masses = np.array([(robot.hull[-1][0] * 2, robot.mass) for robot in robots]).T
    assert lengths.min() < 0.3
    assert lengths.max() > 5
    assert masses.min() < 2
    assert masses.max() > 3000
