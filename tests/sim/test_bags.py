from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from full_log import BEAMS, MOUNT, ROWS, full_log
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.interfaces import QosDurability
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from sim.bags.topics import START
from sim.bags.writer import write_bag
from trackslip.errors import InvalidValueError, OutputError
from trackslip.kinematics import RobotGeometry

GEOMETRY = RobotGeometry(0.2, 0.05)


@pytest.fixture(scope="module")
def log():
    return full_log()


def read(path):
    """Messages by topic as rosbags reads them: (stamp [ns], message)."""
    store = get_typestore(Stores.ROS2_JAZZY)
    found = {}
    with Reader(path) as reader:
        for connection, arrival, data in reader.messages():
            message = store.deserialize_cdr(data, connection.msgtype)
            is_transform = hasattr(message, "transforms")
            header = message.transforms[0].header if is_transform else message.header
            stamp = header.stamp.sec * 10**9 + header.stamp.nanosec
            assert arrival == stamp
            found.setdefault(connection.topic, []).append((stamp, message))
    return found


def numbers(rows, *paths):
    """Values (rows, paths) of fields of messages, whose paths have dots."""

    def field(message, path):
        for name in path.split("."):
            message = getattr(message, name)
        return message

    return np.array([[field(message, path) for path in paths] for _, message in rows])


def assert_stamps(rows, time):
    exact = [round(t * 1e9) for t in time.tolist()]
    assert [stamp - START * 10**9 for stamp, _ in rows] == exact


def assert_poses(rows, prefix, pose):
    place = numbers(rows, f"{prefix}.position.x", f"{prefix}.position.y")
    np.testing.assert_array_equal(place, pose[:, :2])
    quaternion = numbers(rows, *(f"{prefix}.orientation.{name}" for name in "xyzw"))
    heading = Rotation.from_euler("z", pose[:, 2:])
    missed = Rotation.from_quat(quaternion) * heading.inv()
    assert missed.magnitude().max() < 1e-15


def test_every_topic_is_read_back_bit_for_bit(log, tmp_path):
    write_bag(log, tmp_path / "bag", GEOMETRY)
    bag = read(tmp_path / "bag")
    valid = log.valid
    count = Counter()
    with (tmp_path / "bag" / "bag.mcap").open("rb") as file:
        reader = make_reader(file, True, [DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            stamp, own = bag[channel.topic][count[channel.topic]]
            assert message.log_time == message.publish_time == stamp
            if channel.topic == "/joint_states":
                assert decoded.velocity == own.velocity.tolist()
            count[channel.topic] += 1
    assert count == {topic: len(rows) for topic, rows in bag.items()}
    for topic in ("/joint_states", "/odom", "/cmd_vel", "/ground_truth", "/scan"):
        assert_stamps(bag[topic], log.time)
    assert_stamps(bag["/pose"], log.time[valid])
    assert_stamps(bag["/tf_static"], log.time[:1])

    joints = [message for _, message in bag["/joint_states"]]
    assert all(message.name == ["left_sprocket", "right_sprocket"] for message in joints)
    np.testing.assert_array_equal([message.velocity for message in joints], log.omega)
    turned = np.diff([message.position for message in joints], axis=0)
    speed = turned / np.diff(log.time)[:, None]
    np.testing.assert_allclose(speed, log.omega[1:], rtol=0, atol=1e-12)

    assert_poses(bag["/pose"], "pose.pose", log.pose[valid])
    covariance = numbers(bag["/pose"], "pose.covariance")[:, 0]
    planar = np.ix_([0, 1, 5], [0, 1, 5])
    in_plane = [matrix.reshape(6, 6)[planar] for matrix in covariance]
    np.testing.assert_array_equal(in_plane, log.covariance[valid])

    assert_poses(bag["/ground_truth"], "pose.pose", log.truth.pose)
    moved = ("twist.twist.linear.x", "twist.twist.linear.y", "twist.twist.angular.z")
    np.testing.assert_array_equal(numbers(bag["/ground_truth"], *moved), log.truth.twist)

    scans = [message for _, message in bag["/scan"]]
    ranges = np.array([message.ranges for message in scans])
    np.testing.assert_array_equal(ranges[:, ::4], np.inf)  # REP 117
    np.testing.assert_array_equal(np.where(np.isinf(ranges), np.nan, ranges), log.scans.full)
    bearings = scans[0].angle_min + scans[0].angle_increment * np.arange(BEAMS)
    np.testing.assert_allclose(bearings, log.scans.scan.bearings, atol=1e-6)


def test_transforms_lead_from_the_map_to_the_robot(log, tmp_path):
    write_bag(log, tmp_path / "bag", GEOMETRY)
    bag = read(tmp_path / "bag")
    chain = {}
    for stamp, message in (*bag["/tf"], *bag["/tf_static"]):
        (one,) = message.transforms
        matrix = np.eye(4)
        turn = one.transform.rotation
        way = one.transform.translation
        matrix[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
        matrix[:3, 3] = way.x, way.y, way.z
        chain[one.header.frame_id, one.child_frame_id, stamp] = matrix
    poses = [(stamp, message.pose.pose.position) for stamp, message in bag["/pose"]]
    assert len(chain) == 1 + ROWS + len(poses)
    for stamp, place in poses:
        found = chain["map", "odom", stamp] @ chain["odom", "base_link", stamp]
        np.testing.assert_allclose(found[:2, 3], [place.x, place.y], atol=1e-13)
    mount = next(matrix for (_, child, _), matrix in chain.items() if child == "laser")
    np.testing.assert_array_equal(mount[:2, 3], MOUNT[:2])
    assert np.arctan2(mount[1, 0], mount[0, 0]) == pytest.approx(MOUNT[2], abs=1e-15)
    with Reader(tmp_path / "bag") as reader:
        (static,) = [each for each in reader.connections if each.topic == "/tf_static"]
    assert static.ext.offered_qos_profiles[0].durability is QosDurability.TRANSIENT_LOCAL


def test_refusals(log, tmp_path):
    (tmp_path / "there").mkdir()
    with pytest.raises(OutputError, match=r"there: exists already$"):
        write_bag(log, tmp_path / "there")
    too_late = replace(log, time=log.time + 1e10)
    said = r"times of the run = .*: must be stamps from 0 to 2147483647 s"
    with pytest.raises(InvalidValueError, match=said):
        write_bag(too_late, tmp_path / "bag")
    assert not (tmp_path / "bag").exists()
