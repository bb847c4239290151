"""Steady stretches whose load turns with the robot."""

import numpy as np
import pytest

from trackslip.errors import LogError
from trackslip.identification.samples import usable_samples
from trackslip.kinematics import RobotGeometry
from trackslip.laws.icr_load import IcrLoad
from trackslip.logs.runlog import RunLog

GEOMETRY = RobotGeometry(0.168, 0.06)
LAW = IcrLoad(0.04, 0.168, 0.01, 0.1, 0.2)
OMEGA = np.array([1.5, 3.5])


def driven(slope: float, known: bool = True) -> RunLog:
    """A circle on a slope, as the law says; the robot's pose is integrated finely."""
    step, fine = 0.05, 4
    time = np.arange(0, 14.0, step)
    pose, poses = np.zeros(3), []
    loads = []
    for _ in time:
        for k in range(fine):
            load = np.tan(slope) * np.array([np.cos(pose[2]), -np.sin(pose[2])])
            if k == 0:
                poses.append(pose)
                loads.append(load)
            law = LAW.under(load)
            v, w = law.twist(OMEGA, GEOMETRY)
            u, dt = float(law.sideslip(np.array([v, w]))), step / fine
            heading = pose[2] + w * dt / 2
            cos, sin = np.cos(heading), np.sin(heading)
            pose = pose + dt * np.array([cos * v - sin * u, sin * v + cos * u, w])
    return RunLog("run", time, np.tile(OMEGA, (len(time), 1)), np.array(poses), load=np.array(loads) if known else None)


def test_pieces_follow_the_law_where_the_whole_circle_is_not_steady():
    log = driven(0.17)
    with pytest.raises(LogError, match="its motion is not: v changes"):
        usable_samples([log], GEOMETRY, longest=True)
    pieces = usable_samples([log], GEOMETRY).samples
    expected = LAW.under(pieces.load).twist(pieces.omega, GEOMETRY)
    np.testing.assert_allclose(pieces.twist, expected, atol=2e-3)
