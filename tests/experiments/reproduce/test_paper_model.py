"""The paper's robot, simulated by its own equations."""

import numpy as np
import pytest
from scipy.optimize import brentq

from experiments.reproduce.paper_model import PERIOD, driven
from trackslip.kinematics import advance
from trackslip.metrics import body_errors
from trackslip.slip.constant import NoSlip
from trackslip.slip.exponential import PUBLISHED
from trackslip.trajectory.segmented import paper_reference

PAPER = paper_reference()
START = PAPER.pose(0.0)


def run(controller, start, law, geometry):
    return driven({controller: start}, [law], geometry, PAPER)[controller][0]


def distances(log):
    error = body_errors(log.pose, PAPER.pose(log.time))
    return np.hypot(error[:, 0], error[:, 1])


def radius_driven(commanded, geometry):
    """The fixed point of Eq. 5 under the published slips, for sprocket speeds commanded without compensation."""
    outer, inner = commanded + geometry.half_gauge, commanded - geometry.half_gauge

    def missed(radius):
        right = outer * (1 - 0.07 * np.exp(-0.68 * radius))
        left = inner * (1 + 0.15 * np.exp(-0.63 * radius))
        return geometry.half_gauge * (right + left) / (right - left) - radius

    return brentq(missed, commanded, 3 * commanded)


def test_with_its_own_law_the_robot_drives_the_path(geometry):
    late = 2 * PERIOD * 0.15  # commands are held for a period
    assert distances(run("feedforward", START, PUBLISHED, geometry)).max() < late


def test_without_compensation_it_drives_the_wider_arc_that_its_law_says(geometry):
    log = run("feedforward", START, NoSlip(), geometry)
    turning = (log.time > 14) & (log.time < 32)
    step = np.diff(log.pose[turning], axis=0)
    radius = np.hypot(step[:, 0], step[:, 1]) / step[:, 2]
    np.testing.assert_allclose(radius, radius_driven(1.25, geometry), rtol=1e-4)
    assert distances(log)[-1] > 1.0


@pytest.mark.parametrize("controller", ["feedforward", "linear"])
def test_the_path_is_that_of_the_law_solved_at_each_step(geometry, controller):
    log = run(controller, np.add(START, [0.1, 0.0, 0.2]), NoSlip(), geometry)
    pose = log.pose[0]
    for twist in PUBLISHED.twist(log.omega, geometry)[:-1]:
        pose = advance(pose, twist, PERIOD)
    assert np.hypot(*(pose - log.pose[-1])[:2]) < 2e-6  # "about a micrometre"
