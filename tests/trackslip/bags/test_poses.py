from functools import reduce

import numpy as np
import pytest
from bags import (
    KINDS,
    START,
    chain_of,
    fix,
    in_order,
    odometry,
    open_bag,
    pose_stamped,
    pose_with_covariance,
    poses_of,
    quaternion,
    stamp,
    transform,
    write_bag,
)
from hypothesis import given
from hypothesis import strategies as st
from plain_drives import wandered
from scipy.spatial.transform import Rotation

from trackslip import se2
from trackslip.bags.choice import AUTOMATIC
from trackslip.bags.poses import headings, read_poses
from trackslip.bags.topics import pose_source, pose_sources
from trackslip.errors import LogError

LOG = wandered(duration=8.0)
SEEN = LOG.pose[LOG.is_valid]
WRAPPED = np.column_stack([SEEN[:, :2], se2.wrap_angle(SEEN[:, 2])])
SOURCES = {"/odom": odometry, "/slam/pose": pose_stamped, "/amcl_pose": pose_with_covariance}


def read(tmp_path, messages, source, kind="mcap"):
    notes = []
    bag = open_bag(write_bag(tmp_path / "run", kind, messages))
    return read_poses(bag, source, notes), notes


@pytest.mark.parametrize(
    ("topic", "kind"), [*zip(SOURCES, KINDS[1:], strict=True), ("/odom", KINDS[0])]
)
def test_poses_of_every_type(tmp_path, kind, topic):
    found, notes = read(tmp_path, poses_of(LOG, SOURCES[topic]), topic, kind)
    np.testing.assert_array_equal(found.values[:, :2], SEEN[:, :2])
    np.testing.assert_allclose(found.values[:, 2], WRAPPED[:, 2], atol=1e-12)
    np.testing.assert_array_equal(found.stamp, [stamp(t) for t in LOG.time[LOG.is_valid]])
    np.testing.assert_allclose(found.delay, 1e-3)
    assert not notes


@given(st.floats(-3.1, 3.1), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_headings_are_those_of_the_x_axis_from_above(yaw, pitch, roll):
    turned = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    notes = []
    level = [0, 0, 0, 1]
    quaternions = np.stack([turned.as_quat(), level, level])
    found, *_ = headings(quaternions, "topic /a", notes)
    x, y, _ = turned.apply([1.0, 0.0, 0.0])
    assert se2.wrap_angle(found - np.arctan2(y, x)) == pytest.approx(0.0, abs=1e-9)
    _, _, up = turned.apply([0.0, 0.0, 1.0])
    tilt = np.arccos(min(up, 1.0))
    assert bool(notes) == (tilt > np.radians(20))


def with_turn(turn, rows=range(80)):
    messages = poses_of(LOG)
    for k in rows:
        topic, kind, at, fields = messages[k]
        pose = fields["pose"] | {"orientation": turn}
        messages[k] = topic, kind, at, fields | {"pose": pose}
    return messages


def turned(x, y, z, w):
    return {"x": x, "y": y, "z": z, "w": w}


SIDEWAYS = turned(*Rotation.from_euler("ZYX", [0.3, 0, -np.pi / 2]).as_quat().tolist())
"""A camera's optical frame: z forwards."""


@pytest.mark.parametrize(
    ("messages", "note"),
    [
        (
            with_turn(SIDEWAYS),
            "its frame is tilted by more than 20° in 80 of 80 poses, by up to 90°: headings left",
        ),
        (
            with_turn(turned(0.0, 0.0, 0.0, 0.0)),
            "most of its quaternions are not of unit length: read without",
        ),
        (with_turn(turned(0.0, 0.0, 0.0, 1.0)), "its heading never changes: read without headings"),
    ],
)
def test_orientations_that_are_no_headings(tmp_path, messages, note):
    found, (said,) = read(tmp_path, messages, "/slam/pose")
    assert np.isnan(found.values[:, 2]).all()
    assert said.startswith(f"topic /slam/pose: {note}")


TILTED = quaternion(SEEN[10, 2], np.radians(31))
ASTRAY = poses_of(LOG)
ASTRAY[7] = pose_stamped(stamp(0.7), (np.nan, 0.0, 0.0))


@pytest.mark.parametrize(
    ("messages", "without", "note"),
    [
        (
            with_turn(TILTED, [10]),
            [],
            "tilted by more than 20° in 1 of 80 poses, by up to 31°: slip is identified in",
        ),
        (ASTRAY, [7], "1 of 80 poses left out: x or y is not finite"),
    ],
)
def test_poses_that_mean_nothing_are_left_out(tmp_path, messages, without, note):
    found, (said,) = read(tmp_path, messages, "/slam/pose")
    np.testing.assert_allclose(found.values, np.delete(WRAPPED, without, axis=0), atol=1e-9)
    assert said.startswith(f"topic /slam/pose: {note}")


def test_fixes_are_read_and_those_without_are_left_out(tmp_path):
    messages = []
    for k in range(20):
        latitude = 47.0 + 1e-6 * k
        longitude = 8.0 - 1e-6 * k
        status = -1 if k in (3, 4) else 2
        messages.append(fix(stamp(k / 5), latitude, longitude, 400.0, status=status))
    found, notes = read(tmp_path, messages, "/fix")
    assert found.values.shape == (18, 3)
    assert np.isnan(found.values[:, 2]).all()
    assert found.values[-1, 1] == pytest.approx(19 * 0.1112, rel=1e-3)
    assert found.values[-1, 0] < 0
    assert notes == ["topic /fix: 2 of 20 messages left out: they have no fix"]
    without = [fix(stamp(k), 0.0, 0.0, status=-1) for k in range(3)]
    with pytest.raises(LogError, match="topic /fix: none of its 3 messages has a fix"):
        read(tmp_path / "none", without, "/fix")


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_a_chain_of_transforms_is_sampled_at_its_slowest_link(tmp_path, kind):
    found, _ = read(tmp_path, chain_of(LOG), "tf:map:sensor", kind)
    times = np.arange(8) + 0.52
    np.testing.assert_array_equal(found.stamp, [stamp(t) for t in times])
    on_robot = (0.2, 0.1, 0.5)
    for time, where in zip(times, found.values, strict=True):
        corrected = (1.0 + 0.01 * np.floor(time), 2.0, 0.3)
        between = [np.interp(time, LOG.time, column) for column in LOG.pose.T]
        expected = reduce(se2.compose, [corrected, between, on_robot])
        np.testing.assert_allclose(where[:2], expected[:2], atol=1e-9)
        assert se2.wrap_angle(where[2] - expected[2]) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("source", "line"),
    [
        (
            "tf:map:robot",
            "frame 'robot' is not in the transforms; they have base_link, cup, map, odom, "
            "sensor, table",
        ),
        (
            "tf:map:cup",
            "frames 'map' and 'cup' are not connected by transforms: 'map' is in 'map', 'cup' in "
            "'table'",
        ),
        ("tf:table:cup", "the transforms from 'table' to 'cup' never change"),
        ("/scan", "it has no topic '/scan'"),
        ("/odd", r"topic /odd has messages of odd_msgs/.*; poses are read from nav_msgs/"),
    ],
)
def test_sources_that_do_not_exist(tmp_path, source, line):
    more = [
        transform(START, "table", "cup", (0, 0, 0), topic="/tf_static"),
        ("/odd", "odd_msgs/msg/Odd", START, {}),
    ]
    with pytest.raises(LogError, match=line):
        read(tmp_path, [*chain_of(LOG), *more], source)


def sources(tmp_path, *messages):
    bag = open_bag(write_bag(tmp_path / "run", "mcap", in_order(*messages)))
    return bag, [source.name for source in pose_sources(bag)]


def test_sources_by_how_independent_of_the_wheels_they_are(tmp_path):
    wheels = poses_of(LOG, odometry)
    goal = poses_of(LOG, topic="/goal_pose")
    fused = poses_of(LOG, odometry, topic="/odometry/filtered")
    truth = poses_of(LOG, odometry, topic="/ground_truth")
    mocap = poses_of(LOG, topic="/vrpn/robot/pose")
    gnss = [fix(stamp(t), 47.0, 8.0) for t in LOG.time]
    slam = poses_of(LOG)
    bag, names = sources(tmp_path, wheels, goal, fused, truth, mocap, gnss, chain_of(LOG), slam)
    assert names == [
        "/vrpn/robot/pose",
        "/slam/pose",
        "tf:map:base_link",
        "/fix",
        "/ground_truth",
        "/odometry/filtered",
        "/odom",
    ]
    assert pose_source(bag, AUTOMATIC).name == "/vrpn/robot/pose"


def as_transforms(name):
    """LOG's poses as transforms of a frame."""
    return poses_of(LOG, lambda at, where: transform(at, "map", name, where))


ROBOTS = [*as_transforms("a/base_link"), *as_transforms("b/base_link")]


@pytest.mark.parametrize(
    ("messages", "line"),
    [
        (
            [poses_of(LOG), poses_of(LOG, pose_with_covariance)],
            "poses may be /amcl_pose, /slam/pose: choose with",
        ),
        ([ROBOTS], "poses may be tf:map:a/base_link, tf:map:b/base_link: choose with --poses"),
        (
            [poses_of(LOG, topic="/goal_pose")],
            r"no poses: no other topic of .*; its topics are /goal_pose",
        ),
    ],
)
def test_what_leaves_a_doubt_is_for_the_user_to_choose(tmp_path, messages, line):
    bag, _ = sources(tmp_path, *messages)
    with pytest.raises(LogError, match=line):
        pose_source(bag, AUTOMATIC)
