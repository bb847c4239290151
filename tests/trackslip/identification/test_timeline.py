from dataclasses import replace

import numpy as np
import pytest
from drives import SLAM, drive_log, held, model

from trackslip.identification.preparation import Timeline, drive_of, interval_means

DRIVES = [drive_of(drive_log(seed, 10.0 + seed)) for seed in range(3)]
EVERY = np.arange(len(model("turn_loss").names))


@pytest.mark.parametrize("clock_offset", [0.003, 0.703, -4.003])
@pytest.mark.parametrize("lag", [0.0, 0.2])
def test_each_of_several_drives_moves_as_it_does_alone(clock_offset, lag):
    driven = model("turn_loss")
    values = np.array([0.045, 0.0066, 0.3, 0.1, 0.05, 0.2, clock_offset, 0.07, lag])
    together, begin = driven.path(values, Timeline.of(DRIVES), EVERY), 0
    for drive in DRIVES:
        alone, rows = driven.path(values, Timeline.of([drive]), EVERY), slice(begin, begin + len(drive.time))
        turn = together.heading[begin] - alone.heading[0]
        moved = (together.place[rows] - together.place[begin]) * np.exp(-1j * turn)
        np.testing.assert_allclose(moved, alone.place - alone.place[0], atol=1e-10)
        np.testing.assert_allclose(together.heading[rows] - turn, alone.heading, atol=1e-11)
        slope = together.heading_slope[:, rows] - together.heading_slope[:, [begin]]
        np.testing.assert_allclose(slope, alone.heading_slope - alone.heading_slope[:, :1], atol=1e-9)
        begin += len(drive.time)


def test_the_first_and_the_last_motion_of_a_drive_continue_beyond_its_ends():
    line = Timeline.of(DRIVES)
    for shift, end in ((-100.0, line.first), (100.0, line.last)):
        assert line.intervals(line.time + shift).tolist() == end.tolist()


def test_a_reading_that_is_logged_again_and_again_counts_once_in_the_middle_of_its_time():
    time = 0.05 * np.arange(400)
    omega = np.column_stack([3 * np.sin(time), 2 + np.cos(0.7 * time)])
    as_read = held(time, omega, 0.2, (0.0, 0.1))
    later = time[1:] - 0.025 - 0.05  # a reading stands for the row's interval and the three after it
    expected = np.column_stack([3 * np.sin(later), 2 + np.cos(0.7 * later)])
    np.testing.assert_allclose(interval_means(time, as_read)[10:-10], expected[10:-10], atol=0.02)
    assert np.abs(as_read[1:] - expected)[10:-10].max() > 0.2


def test_speeds_that_are_read_at_every_row_or_do_not_change_are_the_means_since_the_row_before():
    time = 0.05 * np.arange(400)
    rng = np.random.default_rng(0)
    steps = np.repeat(rng.normal(size=(8, 2)), 50, axis=0)  # commands of 2.5 s
    for omega in (rng.normal(size=(400, 2)), steps, np.zeros((400, 2)), np.ones((400, 2))):
        np.testing.assert_array_equal(interval_means(time, omega), omega[1:])


def test_poses_more_often_than_20_hz_are_thinned():
    log = drive_log(1, 20, replace(SLAM, rate=180.0))
    drive = drive_of(log)
    assert np.median(np.diff(drive.time)) == pytest.approx(0.05, rel=0.15)
    assert len(drive_of(drive_log(1, 20, replace(SLAM, rate=30.0))).time) == pytest.approx(600, abs=10)
