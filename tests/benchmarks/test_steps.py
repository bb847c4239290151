"""Times of the controllers, without bounds."""

import numpy as np
import pytest

from experiments.common.lookup import controller
from trackslip.controllers.named import CONTROLLERS
from trackslip.kinematics import RobotGeometry
from trackslip.trajectory.named import load_reference


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_hundred_steps_of_a_controller(benchmark, name):
    """A hundred steps of a single robot, 5 cm beside a circle."""
    pilot, path = controller(name, RobotGeometry(0.168, 0.06), 0.3, 0.05), load_reference("circle")
    times = 0.05 * np.arange(100)
    poses = path.pose(times) + np.array([0.05, 0.0, 0.0])

    def drive():
        pilot.reset()
        for time, pose in zip(times, poses, strict=True):
            pilot.twist(time, pose[None], path)

    benchmark(drive)
