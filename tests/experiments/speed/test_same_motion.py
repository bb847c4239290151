import numpy as np
import pytest

from experiments.speed import same_motion
from experiments.speed.same_motion import WholeMotion
from sim.fleet import Fleet

PERIOD = 0.05


@pytest.mark.parametrize("threads", [1, 2])
def test_the_bare_engine_repeats_a_whole_motion(robot, monkeypatch, threads):
    fleet = Fleet(robot, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.5]], threads=1)
    motion = WholeMotion(fleet, PERIOD)
    for k in range(8):
        fleet.command([[2.0 + 0.1 * k, 2.0], [3.0, 1.0 + 0.3 * k]])
        fleet.advance(PERIOD)
        motion.note()
    driven, copied = [], same_motion.bare_copy

    def watched(*arguments):
        driven.append(copied(*arguments))
        return driven[-1]

    monkeypatch.setattr(same_motion, "bare_copy", watched)
    for _ in range(2):
        assert motion.repeat(threads) > 0
    assert np.hypot(*(fleet.batch.qpos - motion.at_start(threads).qpos)[:, :2].T).min() > 0.03
    for bare in driven[:2]:
        assert bare.nthread == threads
        np.testing.assert_array_equal(bare.qpos, fleet.batch.qpos)
