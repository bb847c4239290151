"""The paper's robot by its own equations."""

import numpy as np
import pytest
from scipy.optimize import brentq

from experiments.driving.paper_model import PERIOD, driven, published_poses
from trackslip.kinematics import RobotGeometry, advance
from trackslip.logs.runlog import RunLog
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
    """Where Eq. 5 with the published slips and the sprocket speeds without slip gives the radius itself."""
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


def test_feedback_brings_it_back_to_the_path(geometry):
    beside = np.array([0.3, -0.2, np.pi / 3])
    plain, compensated = (distances(run("linear", beside, law, geometry)) for law in (NoSlip(), PUBLISHED))
    assert compensated[0] == pytest.approx(np.hypot(0.3, 0.2))
    assert compensated[400] < 1e-3 < 0.01 < plain[400]


def test_a_steady_run_lies_on_the_circle_of_its_law(geometry):
    time = np.arange(0, 20, 0.1)
    omega = NoSlip().sprocket_speeds(np.array([0.15, 0.1]), geometry)
    log = RunLog(
        "r", time, np.tile(omega, (200, 1)), np.tile([1.0, 2.0, 3.0], (200, 1)),
        metadata={"geometry": {"half_gauge": geometry.half_gauge, "sprocket_radius": geometry.sprocket_radius}},
    )  # fmt: skip
    pose = published_poses(log)
    np.testing.assert_array_equal(pose[0], [1, 2, 3])
    centre = np.array([1.0, 2.0]) + radius_driven(1.5, geometry) * np.array([-np.sin(3), np.cos(3)])
    np.testing.assert_allclose(np.hypot(*(pose[:, :2] - centre).T), radius_driven(1.5, geometry), rtol=1e-6)


@pytest.mark.parametrize("controller", ["feedforward", "linear"])
def test_the_path_is_that_of_the_law_solved_at_each_step(geometry, controller):
    log = run(controller, np.add(START, [0.1, 0.0, 0.2]), NoSlip(), geometry)
    pose = log.pose[0]
    for twist in PUBLISHED.twist(log.omega, geometry)[:-1]:
        pose = advance(pose, twist, PERIOD)
    assert np.hypot(*(pose - log.pose[-1])[:2]) < 2e-6  # "about a micrometre"


def test_the_published_radii_are_met(geometry):
    """Eq. 11 and the radii in the legend of Fig. 5 belong together."""
    paper = RobotGeometry(0.168, geometry.sprocket_radius)
    driven = [radius_driven(radius, paper) for radius in (0.5, 1.0, 1.5, 2.0, 2.5)]
    np.testing.assert_allclose(driven, [0.62, 1.34, 2.05, 2.68, 3.12], rtol=0.08)
