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


def found(robot, ground, free, inputs, noise, seed):
    """Estimates of the free parameters of a drawn robot from ten of its drives, and their true values."""
    rng = np.random.default_rng(seed)
    base = Candidate(load_parameters(robot)[0], ground)
    truth = drawn(base, free, rng)
    fit = calibrate(Drives(driven(truth, rng, noise=noise), base.geometry, inputs), base, free)
    return [(name, one, truth.value(name)) for name, one in fit.estimates.items()]


def test_a_robot_is_found_again_with_its_sensor_and_clock():
    for name, one, truth in found(*CASES[0], seed=100):
        assert not one.held, name
        assert abs(one.value - truth) < 3.5 * one.stderr, name
        assert one.stderr < {"clock": 0.02, "friction_ratio": 0.05}.get(name, 0.03), name


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=[case[0] for case in CASES])
def test_intervals_contain_the_truth(case):
    """Of about 60 intervals of 95 %, at least 88 % do."""
    inside = [
        one.low <= truth <= one.high for seed in range(200, 210) for _, one, truth in found(*case, seed) if not one.held
    ]
    assert len(inside) >= 30
    assert np.mean(inside) >= 0.88, np.mean(inside)
