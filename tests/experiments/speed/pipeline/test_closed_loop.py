import numpy as np

from experiments.speed.pipeline import closed_loop
from experiments.speed.pipeline.closed_loop import Times, drive, paper_pilots
from experiments.speed.same_motion import SameMotion
from trackslip.trajectory.segmented import PAPER_START, Segment, SegmentedReference


def test_the_bare_engine_repeats_the_motion_of_the_loop(robot, monkeypatch):
    monkeypatch.setattr(closed_loop, "_PATH", SegmentedReference(PAPER_START, [Segment(0.5, 0.0, 0.1)]))
    ways, gaps = [], []
    repeat = SameMotion.repeat

    def watched(self):
        before = self._bare.qpos.copy()
        took = repeat(self)
        ways.append(np.hypot(*(self._bare.qpos - before)[:, :2].T))
        gaps.append(np.abs(self._bare.qpos - self._fleet.batch.qpos))
        return took

    monkeypatch.setattr(SameMotion, "repeat", watched)
    times = Times()
    drive(robot, paper_pilots(), 0, times)
    assert len(gaps) == 10
    assert np.max(gaps) == 0
    assert np.min(ways[-1]) > 1e-3
    assert len(times.whole) == len(times.bare) == 9  # the first period has no beginning
    assert min(times.whole) > 0
    assert times.ratio > 1


def test_the_ratio_is_the_median_over_the_periods():
    assert Times([2.0, 3.0, 40.0], [1.0, 1.0, 4.0]).ratio == 3.0
