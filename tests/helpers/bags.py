"""Bags as robots and other programs write them, with a plate's scans too: by rosbags and by MCAP's
own writer.
"""

from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from beside import Session
from mcap.writer import CompressionType
from mcap_ros2.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from trackslip.bags.open import open_bags

START = 1_700_000_000_000_000_000  # [ns]
KINDS = ("ros1", "sqlite3", "mcap", "foxglove")
JOINTS = "sensor_msgs/msg/JointState"
ODOMETRY = "nav_msgs/msg/Odometry"
STAMPED = "geometry_msgs/msg/PoseStamped"
WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
FIX = "sensor_msgs/msg/NavSatFix"
IMU = "sensor_msgs/msg/Imu"
TF = "tf2_msgs/msg/TFMessage"
JOINT_NAMES = ("left_wheel_joint", "right_wheel_joint")
SCAN = "sensor_msgs/msg/LaserScan"


@cache
def store(ros1):
    types = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    if ros1:
        types.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    types.register(get_types_from_msg("string text\nuint8[] what", "odd_msgs/msg/Odd"))
    return types


def write_bag(path, kind, messages, *, compression=None):
    """Write messages (topic, type, arrival [ns], fields as nested dicts) in order; returns the path
    to open.

    `compression` is none, file, message or storage for rosbags' ROS 2 bags, bz2 or lz4 for ROS 1.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    if kind == "foxglove":
        return _foxglove(path.with_suffix(".mcap"), messages, compression)
    if kind == "ros1":
        file = path.with_suffix(".bag")
        writer = Writer1(file)
        writer.chunk_threshold = 100_000
        if compression:
            writer.set_compression(Writer1.CompressionFormat[compression.upper()])
        return _rosbags(file, writer, messages, ros1=True)
    writer = Writer2(path, version=9, storage_plugin=StoragePlugin[kind.upper()])
    if compression:
        writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    return _rosbags(path, writer, messages, ros1=False)


def _rosbags(path, writer, messages, ros1):
    types = store(ros1)
    connections = {}
    with writer:
        for topic, kind, arrival, fields in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=types)
            message = _built(types, kind, fields)
            if ros1:
                data = types.serialize_ros1(message, kind)
            else:
                data = types.serialize_cdr(message, kind)
            writer.write(connections[topic], arrival, data)
    return path


def _foxglove(path, messages, compression):
    types = store(False)
    schemas = {}
    packing = CompressionType[(compression or "zstd").upper()]
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=20_000, compression=packing)
        for topic, kind, arrival, fields in messages:
            if kind not in schemas:
                text, _ = types.generate_msgdef(kind, ros_version=2)
                schemas[kind] = writer.register_msgdef(kind, text)
            writer.write_message(
                topic, schemas[kind], fields, log_time=arrival, publish_time=arrival
            )
        writer.finish()
    return path


def _built(types, kind, fields):
    """A message of rosbags from nested dicts; fields that are left out are zero or empty."""
    made = {}
    for name, (node, detail) in types.fielddefs[kind][1]:
        value = fields.get(name)
        if int(node) == 2:  # another message
            made[name] = _built(types, detail, value or {})
        elif int(node) == 1:
            empty = "" if detail[0] == "string" else 0
            made[name] = empty if value is None else value
        else:
            (inner, base), length = detail
            if int(inner) == 2:
                made[name] = [_built(types, base, one) for one in (value or [])]
            elif base[0] == "string":
                made[name] = list(value or [])
            else:
                numbers = np.zeros(length) if value is None else value
                made[name] = np.array(numbers, base[0])
    return types.types[kind](**made)


def open_bag(path):
    (bag,) = open_bags(path)
    return bag


def stamp(time, start=START):
    """Nanoseconds of a time [s] since `start`."""
    return start + round(time * 1e9)


def header(at, frame=""):
    return {"stamp": {"sec": at // 10**9, "nanosec": at % 10**9}, "frame_id": frame}


def quaternion(heading, pitch=0.0):
    half = heading / 2
    tilt = pitch / 2
    return {
        "x": -np.sin(tilt) * np.sin(half),
        "y": np.sin(tilt) * np.cos(half),
        "z": np.cos(tilt) * np.sin(half),
        "w": np.cos(tilt) * np.cos(half),
    }


def pose(x, y, heading, pitch=0.0):
    return {"position": {"x": x, "y": y, "z": 0.0}, "orientation": quaternion(heading, pitch)}


def covariance(variances):
    """36 numbers with these variances of x, y and yaw."""
    full = np.zeros((6, 6))
    full[[0, 1, 5], [0, 1, 5]] = variances
    return full.ravel().tolist()


def joint_states(at, names, position=(), velocity=(), topic="/joint_states", late=1_000_000):
    fields = {
        "header": header(at),
        "name": list(names),
        "position": list(position),
        "velocity": list(velocity),
    }
    return topic, JOINTS, at + late, fields | {"effort": []}


def odometry(at, where, topic="/odom", frame="odom", variances=(0, 0, 0), late=1_000_000):
    fields = {
        "header": header(at, frame),
        "child_frame_id": "base_link",
        "pose": {"pose": pose(*where), "covariance": covariance(variances)},
    }
    return topic, ODOMETRY, at + late, fields


def pose_stamped(at, where, topic="/slam/pose", late=1_000_000):
    fields = {"header": header(at, "map"), "pose": pose(*where)}
    return topic, STAMPED, at + late, fields


def pose_with_covariance(
    at, where, topic="/amcl_pose", variances=(1e-4, 1e-4, 1e-4), late=1_000_000
):
    fields = {
        "header": header(at, "map"),
        "pose": {"pose": pose(*where), "covariance": covariance(variances)},
    }
    return topic, WITH_COVARIANCE, at + late, fields


def transform(at, parent, child, where, topic="/tf", late=1_000_000, z=0.0, turn=None):
    """The transform to a pose in the plane, or with another quaternion `turn`."""
    x, y, heading = where
    moved = {"translation": {"x": x, "y": y, "z": z}, "rotation": turn or quaternion(heading)}
    one = {"header": header(at, parent), "child_frame_id": child, "transform": moved}
    return topic, TF, at + late, {"transforms": [one]}


def fix(
    at, latitude, longitude, altitude=0.0, status=0, variance=0.01, topic="/fix", late=1_000_000
):
    fields = {
        "header": header(at, "gps"),
        "status": {"status": status, "service": 1},
        "latitude": latitude,
        "longitude": longitude,
        "altitude": altitude,
        "position_covariance": (variance * np.eye(3)).ravel().tolist(),
        "position_covariance_type": 2,
    }
    return topic, FIX, at + late, fields


def sprocket_angles(log):
    """Angles (T, 2) that a log's sprockets have turned by."""
    steps = log.omega[1:] * np.diff(log.time)[:, None]
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def joints_of(log, names=("left_wheel", "right_wheel"), start=START, **others):
    """Joint states with the positions that a log's sprockets turn by."""
    return [
        joint_states(stamp(time, start), names, angle, **others)
        for time, angle in zip(log.time, sprocket_angles(log).tolist(), strict=True)
    ]


def poses_of(log, make=pose_stamped, start=START, **others):
    time = log.time[log.is_valid]
    poses = log.pose[log.is_valid].tolist()
    return [make(stamp(at, start), where, **others) for at, where in zip(time, poses, strict=True)]


def in_order(*messages):
    return sorted((one for some in messages for one in some), key=lambda one: one[2])


def chain_of(log, correction=lambda t: (1.0 + 0.01 * np.floor(t), 2.0, 0.3)):
    """map -> odom once a second, odom -> base_link at 20 Hz, base_link -> sensor once and for
    all.
    """
    messages = [transform(START, "base_link", "sensor", (0.2, 0.1, 0.5), topic="/tf_static")]
    for time, where in zip(log.time, log.pose.tolist(), strict=True):
        messages.append(transform(stamp(time), "odom", "base_link", where))
        if round(time * 20) % 20 == 10:
            messages.append(transform(stamp(time + 0.02), "map", "odom", correction(time)))
    return in_order(messages)


def contents(messages):
    return [
        (m.topic, m.arrival, m.stamp, tuple(m.content.name), *m.content.position) for m in messages
    ]


def expected(messages):
    return [
        (topic, at, at - 1_000_000, ("left_wheel", "right_wheel"), *fields["position"])
        for topic, kind, at, fields in messages
        if kind == JOINTS
    ]


def imu(
    at, rates, frame="imu_link", topic="/imu/data", unknown=False, late=1_000_000, heading=None
):
    """An IMU's angular velocities about its axes [rad/s], and its orientation if it has a heading
    [rad].
    """
    fields = {
        "header": header(at, frame),
        "angular_velocity": dict(zip("xyz", rates, strict=True)),
        "angular_velocity_covariance": [-1.0 if unknown else 0.0, *[0.0] * 8],
    }
    if heading is not None:
        fields["orientation"] = quaternion(heading)
    return topic, IMU, at + late, fields


def scan_messages(session: Session):
    made = []
    rows = session.ranges.astype(np.float32).tolist()
    for time, row in zip(session.time, rows, strict=False):  # fewer times: the first scans
        fields = {
            "header": header(stamp(time), "laser"),
            "angle_min": session.angle_min,
            "angle_max": session.angle_min + session.angle_increment * (len(row) - 1),
            "angle_increment": session.angle_increment,
            "time_increment": session.time_increment,
            "scan_time": 0.05,
            "range_min": 0.05,
            "range_max": 30.0,
            "ranges": row,
        }
        made.append(("/scan", SCAN, stamp(time) + 2_000_000, fields))
    return made


def write_session(path, kind, session: Session, *more):
    encoders = SimpleNamespace(time=session.encoder_time, omega=session.omega)
    encoders = SimpleNamespace(time=session.encoder_time, omega=session.omega)
    joints = joints_of(encoders, JOINT_NAMES)
    return write_bag(path, kind, in_order(joints, scan_messages(session), *more))
