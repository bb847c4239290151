"""Clocks of encoders and poses that differ."""

import numpy as np
import pytest
from looks import DRIVE, KINDS, POSE, TIME, look_at, without
from plain_drives import drive_of, measured

from trackslip.errors import LogError


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("late", [6.0, 30.0, -30.0, 112.0, 1.7e9, -1.7e9])
def test_clocks_that_are_far_apart_are_told(late, kind):
    whose = "pose clock is ahead: subtract that from the times of the poses"
    if late < 0:
        whose = "encoder clock is ahead: subtract that from the times of the encoders"
    with pytest.raises(LogError, match=rf"run 'a': the clocks differ by {abs(late):.1f} s, as the {whose}"):
        look_at(time=TIME + late, pose=without(POSE, kind))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("late", [-1.5, -0.3, 0.7, 1.9])
def test_clocks_that_are_nearly_right_give_a_start_value(late, kind):
    found = look_at(time=TIME + late, pose=without(POSE, kind))
    assert found.clock == pytest.approx(-late, abs=0.05)
    assert found.alarms == ()


@pytest.mark.parametrize("seed", range(3))
def test_poses_of_another_drive_are_not_a_matter_of_clocks(seed):
    found = look_at(DRIVE, *measured(drive_of(seed=10 + seed)))
    assert [alarm.kind for alarm in found.alarms] == ["match"]
    with pytest.raises(LogError, match=r"encoders .* and poses \(1000 to 1120 s\) don't overlap: subtract"):
        look_at(DRIVE, TIME + 1000.0, measured(drive_of(seed=10 + seed))[1])


def test_the_same_round_again_is_no_other_clock():
    around = np.tile([0.5, 0.5, 0.0, 0.0], 8), np.tile([0.0, 0.4, 0.4, 0.0], 8)
    drive = drive_of(commands=around)
    assert abs(look_at(drive, *measured(drive)).clock) < 0.05
