from dataclasses import replace

import numpy as np
import pytest

from trackslip.drives.drive import Drive, Drives

TIME = 0.1 * np.arange(601)
RATE = np.sin(TIME[1:])
TURNED = np.append(0.0, np.cumsum(RATE * np.diff(TIME)))
DRIVE = Drive(
    name="a",
    edges=TIME,
    omega=np.column_stack([2 - RATE, 2 + RATE]),
    time=TIME[::2],
    pose=np.column_stack([TIME[::2], np.zeros(301), TURNED[::2]]),
    interval=0.2,
    gyro=np.column_stack([TIME, TURNED, TIME]),
    beyond=np.array([[-3.0, 0, 0, 0], [70.0, 0, 0, 0]]),
)


def test_a_cut_keeps_the_angles_between_any_two_times():
    part = DRIVE.cut(20.03, 40.07)
    times = np.array([20.03, 20.1, 31.234, 40.07])
    turned = np.diff(part.angles(times))
    np.testing.assert_allclose(turned, np.diff(DRIVE.angles(times)), rtol=1e-12)
    assert part.edges[0] == 20.03
    assert part.edges[-1] == 40.07


def test_a_cut_keeps_the_gyros_turns_between_any_two_times():
    part = DRIVE.cut(20.03, 40.07)
    times = np.array([20.03, 20.1, 31.234, 40.07])
    for column in (1, 2):
        found = np.interp(times, part.gyro[:, 0], part.gyro[:, column])
        whole = np.interp(times, DRIVE.gyro[:, 0], DRIVE.gyro[:, column])
        np.testing.assert_allclose(found, whole, rtol=1e-12)
    assert part.gyro[0, 0] == 20.03
    assert part.gyro[-1, 0] == 40.07


def test_a_cut_keeps_the_poses_within_it_alone():
    part = DRIVE.cut(20.03, 40.07)
    np.testing.assert_array_equal(part.time, DRIVE.time[101:201])
    np.testing.assert_array_equal(part.pose, DRIVE.pose[101:201])
    assert part.beyond is None


def test_encoders_and_gyro_continue_around_a_cuts_poses():
    part = DRIVE.cut(20.0, 40.0, clock=-1.0, around=3.0)
    assert part.time[0] == 20.0
    for time in (part.edges, part.gyro[:, 0]):
        assert time[[0, -1]] == pytest.approx([16.0, 42.0])
    near_the_ends = DRIVE.cut(1.0, 59.0, around=3.0)
    assert near_the_ends.edges[[0, -1]] == pytest.approx([0.0, 60.0])


def test_a_cut_of_a_cut_is_a_cut():
    twice = DRIVE.cut(10.0, 50.0).cut(20.03, 40.07)
    once = DRIVE.cut(20.03, 40.07)
    for name in ("edges", "omega", "time", "pose", "gyro"):
        np.testing.assert_allclose(getattr(twice, name), getattr(once, name), atol=1e-12)


def test_blocks_are_numbered_without_those_that_have_no_poses():
    gap = (DRIVE.time > 12.0) & (DRIVE.time < 48.0)
    with_gap = DRIVE.with_poses(np.flatnonzero(~gap))
    blocks = Drives.of([with_gap, DRIVE]).blocks(2.0)
    # of 0 to 10, 10 to 20, 40 to 50 and 50 to 60 s, then of the second drive's six
    assert np.unique(blocks).tolist() == list(range(4 + 6))


def test_short_drives_of_one_command_share_a_block():
    short = replace(DRIVE.cut(0.0, 8.0), command=(1.0, 2.0))
    other = replace(short, command=(1.0, 3.0))
    blocks = Drives.of([short, short, other]).blocks(2.0)
    assert [blocks[0], blocks[45], blocks[-1]] == [0, 0, 1]


def test_gyro_turns_go_on_from_drive_to_drive():
    drives = Drives.of([DRIVE, DRIVE])
    assert (np.diff(drives.gyro[:, 0]) > 0).all()
    assert drives.gyro[-1, 1] == pytest.approx(2 * TURNED[-1])
