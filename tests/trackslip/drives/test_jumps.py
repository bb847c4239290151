from dataclasses import replace

import numpy as np
from plain_drives import DRIVE, HUSKY, POSE, TIME, log_of

from trackslip import se2
from trackslip.drives.conditioning import drives_of
from trackslip.drives.first_look import first_look

RATE = np.gradient(DRIVE.pose[:, 2], DRIVE.time)


def parts_of(pose):
    log = log_of(DRIVE, TIME, pose)
    (drive,) = drives_of([replace(log, gyro=RATE)])[0]
    return first_look([drive], HUSKY.geometry).drives


def test_gyro_turns_after_a_lasting_jump_are_of_their_own_time():
    jumped = POSE + 30.0 * (TIME > 60.0)[:, None] * [1, 0, 0]
    parts = parts_of(jumped)
    assert len(parts) == 2
    for part in parts:
        first, last = part.gyro[[0, -1], 0]
        assert part.edges[0] == first
        assert part.edges[-1] == last
        assert first >= part.time[0] - 3.1
        assert last <= part.time[-1] + 3.1


def test_jumps_are_the_same_in_any_frame_of_the_poses():
    jumped = POSE + 0.5 * (TIME > 60.0)[:, None] * [1, 0, 0]
    for frame in ([0.0, 0.0, 0.0], [3.0, -2.0, 1.5], [3.0, -2.0, -3.0]):
        first, second = parts_of(se2.compose(np.array(frame), jumped))
        assert first.time[-1] <= 60.0 < second.time[0]
