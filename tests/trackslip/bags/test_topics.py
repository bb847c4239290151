"""Which topic the poses are taken from."""

import pytest
from bags import (
    START,
    chain_of,
    fix,
    in_order,
    odometry,
    open_bag,
    pose_with_covariance,
    poses_of,
    stamp,
    transform,
    write_bag,
)
from wandered import wandered

from trackslip.bags.choice import AUTOMATIC
from trackslip.bags.poses import read_poses
from trackslip.bags.topics import encoder_topics, pose_source, pose_sources, sides
from trackslip.errors import LogError

LOG = wandered(duration=2.0)


def read(tmp_path, messages, source, kind="mcap"):
    notes = []
    found = read_poses(open_bag(write_bag(tmp_path / "run", kind, messages)), source, notes)
    return found, notes


@pytest.mark.parametrize(
    ("source", "line"),
    [
        ("tf:map:robot", "frame 'robot' is not in the transforms; they have base_link, cup, map, odom, sensor, table"),
        ("tf:map:cup", "frames 'map' and 'cup' are not connected by transforms: 'map' is in 'map', 'cup' in 'table'"),
        ("tf:table:cup", "the transforms from 'table' to 'cup' never change"),
        ("/scan", "it has no topic '/scan'"),
        ("/odd", r"topic /odd has messages of odd_msgs/.*; poses are read from nav_msgs/"),
    ],
)
def test_sources_that_do_not_exist(tmp_path, source, line):
    more = [transform(START, "table", "cup", (0, 0, 0), topic="/tf_static"), ("/odd", "odd_msgs/msg/Odd", START, {})]
    with pytest.raises(LogError, match=line):
        read(tmp_path, [*chain_of(LOG), *more], source)


def sources(tmp_path, *messages):
    bag = open_bag(write_bag(tmp_path / "run", "mcap", in_order(*messages)))
    return bag, [source.name for source in pose_sources(bag)]


def test_sources_by_how_independent_of_the_wheels_they_are(tmp_path):
    wheels, goal = poses_of(LOG, odometry), poses_of(LOG, topic="/goal_pose")
    fused = poses_of(LOG, odometry, topic="/odometry/filtered")
    truth = poses_of(LOG, odometry, topic="/ground_truth")
    mocap = poses_of(LOG, topic="/vrpn/robot/pose")
    gnss = [fix(stamp(t), 47.0, 8.0) for t in LOG.time]
    bag, names = sources(tmp_path, wheels, goal, fused, truth, mocap, gnss, chain_of(LOG), poses_of(LOG))
    topics = "/vrpn/robot/pose /slam/pose tf:map:base_link /fix /ground_truth /odometry/filtered /odom"
    assert names == topics.split()
    assert pose_source(bag, AUTOMATIC).name == "/vrpn/robot/pose"


ROBOTS = [
    message
    for name in ("a/base_link", "b/base_link")
    for message in poses_of(LOG, lambda at, where, name=name: transform(at, "map", name, where))
]


@pytest.mark.parametrize(
    ("messages", "line"),
    [
        (
            [poses_of(LOG), poses_of(LOG, pose_with_covariance)],
            "poses may be /amcl_pose, /slam/pose: choose with --poses",
        ),
        ([ROBOTS], "poses may be tf:map:a/base_link, tf:map:b/base_link: choose with --poses"),
        ([poses_of(LOG, topic="/goal_pose")], r"no poses: no topic of .*; its topics are /goal_pose"),
    ],
)
def test_what_leaves_a_doubt_is_for_the_user_to_choose(tmp_path, messages, line):
    bag, _ = sources(tmp_path, *messages)
    with pytest.raises(LogError, match=line):
        pose_source(bag, AUTOMATIC)


@pytest.mark.parametrize(
    ("names", "left", "right"),
    [
        (["left_wheel", "right_wheel"], ["left_wheel"], ["right_wheel"]),
        (["rr_wheel", "fl_wheel", "fr_wheel", "rl_wheel"], ["fl_wheel", "rl_wheel"], ["rr_wheel", "fr_wheel"]),
        (["wheel_FL", "wheel_FR"], ["wheel_FL"], ["wheel_FR"]),
        (["LeftTrack", "RightTrack"], ["LeftTrack"], ["RightTrack"]),
        (["l_sprocket", "r_sprocket"], ["l_sprocket"], ["r_sprocket"]),
        (["leftwheel1", "leftwheel2", "rightwheel1", "rightwheel2"], ["leftwheel1", "leftwheel2"], None),
        (["arm_left_joint", "arm_right_joint", "motor_l", "motor_r"], ["motor_l"], ["motor_r"]),
        (["left_steer", "right_steer", "left_wheel", "right_wheel"], ["left_wheel"], ["right_wheel"]),
        (["panther/fl_wheel_joint", "panther/fr_wheel_joint"], ["panther/fl_wheel_joint"], ["panther/fr_wheel_joint"]),
    ],
)
def test_common_names(names, left, right):
    found = sides(names)
    assert found is not None
    assert list(found[0]) == left
    assert list(found[1]) == (right or [name.replace("left", "right") for name in left])


def test_ticks_are_named_with_what_to_do_with_them(tmp_path):
    counts = [
        (topic, f"std_msgs/msg/{kind}", START, {"data": data})
        for topic, kind, data in (
            ("/left_ticks", "Int32", 5),
            ("/right_ticks", "Int32", 6),
            ("/encoders", "Int64MultiArray", [1, 2]),
        )
    ]
    bag, _ = sources(tmp_path, counts, poses_of(LOG))
    named = r"/encoders \(std_msgs/Int64MultiArray\), /left_ticks \(std_msgs/Int32\), /right_ticks \(std_msgs/Int32\)"
    with pytest.raises(LogError, match=f"{named} may count ticks: publish 2π ticks / .*or write a table"):
        encoder_topics(bag, AUTOMATIC)
