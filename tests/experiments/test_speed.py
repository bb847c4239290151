"""`trackslip bench`: the bare engine repeats the simulator's motion, and slow cases miss their bounds."""

import numpy as np
import pytest

from experiments.simulate.grid_runs import before_scanner
from experiments.simulate.speed import (
    FLEET,
    LOCALIZATION,
    LOOPS,
    REPRODUCE,
    SCANNER,
    TRACKING,
    SameMotion,
    SpeedRatio,
    checks_of,
)
from sim.fleet import Fleet
from sim.loop import closed_loop
from sim.pilot import Pilot
from trackslip.controllers.error_feedback import LinearTimeVarying
from trackslip.trajectory.segmented import circle

COSTS = {LOOPS: 2.0, LOCALIZATION: 0.5, REPRODUCE: 5.0, "stairs": 0.8, "random": 0.8}


def test_the_bare_engine_repeats_the_motion_of_a_closed_loop(robot):
    path = circle(1.25, 0.15, 2.0, before_scanner(robot))
    fleet = Fleet(robot, path.pose(0.0) + np.array([[0, 0, 0], [0.1, 0, 0.1]]), threads=1)
    motion = SameMotion(fleet)
    closed_loop(fleet, [Pilot(LinearTimeVarying(), [0, 1])], path, progress=motion.note)
    assert motion.repeat() > 0
    np.testing.assert_allclose(motion.bare.qpos, fleet.batch.qpos, atol=1e-9)


@pytest.mark.parametrize(
    ("case", "robots", "over_bare", "holds"),
    [(FLEET, 25, 0.91, True), (FLEET, 25, 0.89, False), (SCANNER, 25, 0.69, False), (TRACKING, 1, 0.41, True)],
)
def test_a_case_that_is_too_slow_misses_its_bound(case, robots, over_bare, holds):
    first, *rest = checks_of([SpeedRatio(case, robots, 1e4, over_bare)], COSTS)
    assert first.holds == holds
    assert all(check.holds for check in rest)


@pytest.mark.slow
def test_the_whole_table(trackslip):
    result = trackslip("bench", "--sizes", "1", "3", "--seconds", "0.5", "--repeats", "1")
    assert len(result.summary["speeds"]) == 12
    assert all(one["over_bare"] > 0 for one in result.summary["speeds"])
    assert "Traverse-v0, stairs, 64 robots: speed over that on level ground" in result.stdout
    assert "localization: time over its physics" in [check["name"] for check in result.summary["checks"]]
