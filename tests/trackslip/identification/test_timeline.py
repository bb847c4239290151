import numpy as np
import pytest
from drives import drive_log, model

from trackslip.identification.drives import Timeline, drive_of

DRIVES = [drive_of(drive_log(seed, 10.0 + seed)) for seed in range(3)]
EVERY = np.arange(len(model("turn_loss").names))


@pytest.mark.parametrize("clock_offset", [0.003, 0.703, -4.003])
@pytest.mark.parametrize("lag", [0.0, 0.2])
def test_each_of_several_drives_moves_as_it_does_alone(clock_offset, lag):
    driven = model("turn_loss")
    values = np.array([0.045, 0.0066, 0.3, 0.1, 0.05, 0.2, clock_offset, 0.07, lag])
    together, begin = driven.steps(values, Timeline.of(DRIVES), EVERY), 0
    for drive in DRIVES:
        alone, rows = driven.steps(values, Timeline.of([drive]), EVERY), slice(begin, begin + len(drive.time) - 1)
        np.testing.assert_allclose(together.motion[:, rows], alone.motion, atol=1e-11)
        np.testing.assert_allclose(together.slope[..., rows], alone.slope, atol=1e-9)
        np.testing.assert_allclose(together.distance[rows], alone.distance, atol=1e-11)
        begin += len(drive.time)


def test_steps_between_drives_are_known():
    line = Timeline.of(DRIVES)
    lengths = [len(drive.time) for drive in DRIVES]
    assert line.between.tolist() == [lengths[0] - 1, lengths[0] + lengths[1] - 1]
    assert len(line.time) == sum(lengths)
    assert (np.diff(line.edges) > 0).all()


def test_the_first_and_the_last_motion_of_a_drive_continue_beyond_its_ends():
    line = Timeline.of(DRIVES)
    for shift, end in ((-100.0, line.first), (100.0, line.last)):
        assert line.intervals(line.time + shift).tolist() == end.tolist()
