"""Left and right by the names of joints."""

import pytest

from trackslip.ros.joints import sides


@pytest.mark.parametrize(
    ("names", "left", "right"),
    [
        (["left_wheel", "right_wheel"], ["left_wheel"], ["right_wheel"]),
        (["wheel_left_joint", "wheel_right_joint"], ["wheel_left_joint"], ["wheel_right_joint"]),
        (["rr_wheel", "fl_wheel", "fr_wheel", "rl_wheel"], ["fl_wheel", "rl_wheel"], ["rr_wheel", "fr_wheel"]),
        (["wheel_FL", "wheel_FR"], ["wheel_FL"], ["wheel_FR"]),
        (["LeftTrack", "RightTrack"], ["LeftTrack"], ["RightTrack"]),
        (["l_sprocket", "r_sprocket"], ["l_sprocket"], ["r_sprocket"]),
        (["drivewhl_l_joint", "drivewhl_r_joint"], ["drivewhl_l_joint"], ["drivewhl_r_joint"]),
        (["leftwheel1", "leftwheel2", "rightwheel1", "rightwheel2"], ["leftwheel1", "leftwheel2"], None),
        (["arm_left_joint", "arm_right_joint", "motor_l", "motor_r"], ["motor_l"], ["motor_r"]),
        (["left_arm_1", "left_wheel", "right_wheel", "head_pan"], ["left_wheel"], ["right_wheel"]),
        (
            ["front_left_steer", "front_right_steer", "front_left_wheel", "front_right_wheel"],
            ["front_left_wheel"],
            None,
        ),
        (["panther/fl_wheel_joint", "panther/fr_wheel_joint"], ["panther/fl_wheel_joint"], ["panther/fr_wheel_joint"]),
    ],
)
def test_common_names(names, left, right):
    found = sides(names)
    assert found is not None
    assert list(found[0]) == left
    assert list(found[1]) == (right or [name.replace("left", "right") for name in left])


@pytest.mark.parametrize(
    "names", [[], ["a", "b"], ["wheel1", "wheel2"], ["left_wheel"], ["fl_wheel", "rl_wheel", "fr_wheel"]]
)
def test_names_that_leave_a_doubt(names):
    assert sides(names) is None
