"""Parameters of simulated robots are found again in logs of their drives, as often as the intervals say."""

import numpy as np
import pytest
from simulated_drives import drawn, driven

from sim.calibration.calibration import calibrate
from sim.calibration.candidate import Candidate
from sim.calibration.targets import Drives
from sim.ground.ground import Ground
from sim.robot.named import load_parameters

GRIP = ("friction_ratio", "radius_left", "radius_right", "sensor_x", "sensor_y", "sensor_yaw", "clock")
ICE = ("friction", "friction_ratio", "radius_error", "sensor_x", "clock")
COMMANDS = ("friction_ratio", "radius_error", "lag", "delay", "sensor_x")
CASES = (
    ("shipped", Ground(), GRIP, "encoders", 0.003),
    ("husky", Ground(0.12, 0.12), ICE, "encoders", 0.01),
    ("maxxii", Ground(), COMMANDS, "commands", 0.003),
)


def recovered(robot, ground, free, inputs, noise, seed, count=10):
    """Estimates of a drawn robot's free parameters from some of its drives, and their true values, by name."""
    rng = np.random.default_rng(seed)
    base = Candidate(load_parameters(robot)[0], ground)
    truth = drawn(base, free, rng)
    fit = calibrate(Drives(driven(truth, rng, noise=noise, count=count), base.geometry, inputs), base, free)
    return {name: (estimate, truth.value(name)) for name, estimate in fit.estimates.items()}


def test_a_robot_and_the_clock_of_its_log_are_found_again():
    free = ("friction_ratio", "clock")
    for name, (estimate, truth) in recovered("shipped", Ground(), free, "encoders", 0.003, 100, count=2).items():
        assert not estimate.held, name
        assert abs(estimate.value - truth) < 3.5 * estimate.stderr, name
        assert estimate.stderr < 0.05, name


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=[case[0] for case in CASES])
def test_intervals_contain_the_truth(case):
    """Of about 60 intervals of 95 %, at least 88 % do."""
    pairs = [pair for seed in range(200, 210) for pair in recovered(*case, seed).values()]
    inside = [estimate.low <= truth <= estimate.high for estimate, truth in pairs if not estimate.held]
    assert len(inside) >= 30
    assert np.mean(inside) >= 0.88, np.mean(inside)
