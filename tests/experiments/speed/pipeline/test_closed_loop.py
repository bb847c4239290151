import numpy as np

from experiments.speed.pipeline import closed_loop
from experiments.speed.pipeline.closed_loop import Times, drive, paper_pilots
from trackslip.trajectory.segmented import PAPER_START, Segment, SegmentedReference


def test_the_bare_engine_repeats_the_motion_of_the_loop(robot, monkeypatch):
    monkeypatch.setattr(closed_loop, "_PATH", SegmentedReference(PAPER_START, [Segment(0.5, 0.0, 0.1)]))
    ways, gaps = [], []
    step = closed_loop._Shadow._step

    def watched(self):
        before = self._bare.qpos[:, :2].copy()
        took = step(self)
        ways.append(np.hypot(*(self._bare.qpos[:, :2] - before).T))
        gaps.append(np.hypot(*(self._bare.qpos[:, :2] - self._fleet.batch.qpos[:, :2]).T))
        return took

    monkeypatch.setattr(closed_loop._Shadow, "_step", watched)
    times = Times()
    drive(robot, paper_pilots(), 0, times)
    assert len(gaps) == 10
    assert np.max(gaps) < 1e-3  # the belts have one speed for the whole period
    assert np.max(gaps[1:]) < np.max(ways)
    assert len(times.whole) == len(times.bare) == 9  # the first period has no beginning
    assert min(times.whole) > 0
    assert times.ratio > 1


def test_the_ratio_is_the_median_over_the_periods():
    assert Times([2.0, 3.0, 40.0], [1.0, 1.0, 4.0]).ratio == 3.0
