"""What a drive is made of, from its true motion."""

from __future__ import annotations

import numpy as np

from experiments.driving.wander import drive_contents
from sim.wander.motion import Motion
from trackslip import se2
from trackslip.logs.runlog import RunLog, Truth


def test_ways_turns_and_rests_are_summed():
    """2 s to the left, 1 s to the right, 1 s at rest."""
    twist = np.repeat([[0.2, 0.0, 0.5], [0.1, 0.0, -1.0], [0.0, 0.0, 0.0]], [200, 100, 100], axis=0)
    time, pose = np.arange(401) / 100, se2.chain(np.zeros(3), se2.exp(twist * 0.01))
    valid = np.arange(401) % 5 == 0
    truth = Truth(Motion(time, pose).pose, np.concatenate([np.zeros((1, 3)), twist]))
    log = RunLog("drive", time, np.zeros((401, 2)), pose, valid=valid, truth=truth)
    found = drive_contents(log)
    assert (found["readings"], found["poses"]) == (401, 81)
    measured = [found[name] for name in ("way", "turned_left", "turned_right", "standing")]
    np.testing.assert_allclose(measured, (0.5, 1.0, 1.0, 0.25), rtol=1e-4)
