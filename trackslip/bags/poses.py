"""Poses in the plane, and yaw rates from an IMU's gyro, from the messages in a bag."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation

from trackslip.bags.choice import BagChoice
from trackslip.bags.open import Bag, Topic
from trackslip.bags.stamps import Readings, seconds
from trackslip.bags.topics import FIX, IMU, POSE_TYPES, imu_topic
from trackslip.bags.transforms import (
    MAX_PLACE,
    MAX_TILT,
    are_unit,
    heading_and_tilt,
    pose_numbers,
    read_chain,
)
from trackslip.drives.gyro import yaw_axis
from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.logs.runlog import MAX_YAW_RATE, MEASURED, RunLog

_NO_FIX: Final = 0  # least status of a message with a fix: sensor_msgs/NavSatStatus
_MAX_ALTITUDE: Final = 1e5  # altitude above which a value is invalid [m]
_MIN_EXTENT: Final = 0.1  # extent of a path above which a constant heading is doubtful [m]
_MAX_GAP: Final = 0.2  # longest interval between a gyro's readings that counts as measured [s]


def read_poses(bag: Bag, source: str, notes: list[str]) -> Readings:
    """Read poses (N, 3) in the plane from a topic or from tf:PARENT:CHILD [m, m, rad]; NaN where
    not measured.

    Headings are not unwrapped. Adds a line to `notes` for each part left out and each doubt. Raises
    LogError if there are no poses.
    """
    if source.startswith("tf:"):
        name = source
        _, parent, child = source.split(":")
        poses = read_chain(bag, parent, child, notes)
    else:
        topic = bag.topic(source)
        source, name = topic.name, f"topic {topic.name}"
        poses = _read(bag, topic, notes).ascending(notes)
    if not len(poses.stamp):
        raise LogError(f"{bag.path}: {source}: no pose can be read")
    heading = _headings(name, poses.values, notes)
    return replace(poses, source=source, values=np.column_stack([poses.values[:, :2], heading]))


def _read(bag: Bag, topic: Topic, notes: list[str]) -> Readings:
    """Positions and quaternions (N, 7) from a topic, NaN where not measured; poses with invalid x
    or y are left out.
    """
    if topic.type == FIX:
        return _fixes(bag, topic, notes)
    if topic.type == IMU:
        return bag.table(topic.name, _orientation)
    if topic.type not in POSE_TYPES:
        types = ", ".join((*POSE_TYPES, IMU))
        raise LogError(
            f"{bag.path}: topic {topic.name} has messages of {topic.type}; poses are read from "
            f"{types}"
        )
    poses = bag.table(topic.name, _place_and_turn)
    good = np.asarray((np.abs(poses.values[:, :2]) <= MAX_PLACE).all(axis=1))
    if not good.any():
        raise LogError(f"topic {topic.name}: no position is finite")
    if not good.all():
        notes.append(
            f"topic {topic.name}: {(~good).sum()} of {len(good)} poses left out: x or y is not "
            "finite"
        )
    return poses.take(good)


def _orientation(imu: Any) -> tuple[float, ...]:
    """An IMU's quaternion, after a NaN position; NaN, too, if a covariance of -1 marks it as not
    measured.
    """
    turn, unknown = imu.orientation, (np.nan,) * 3
    measured = imu.orientation_covariance[0] != -1
    return (*unknown, turn.x, turn.y, turn.z, turn.w) if measured else (np.nan,) * 7


def _place_and_turn(content: Any) -> tuple[float, ...]:
    """Position [m] and quaternion from a message that contains a pose."""
    if hasattr(content, "transform"):
        return pose_numbers(content.transform.translation, content.transform.rotation)
    pose = content.pose.pose if hasattr(content.pose, "covariance") else content.pose
    return pose_numbers(pose.position, pose.orientation)


def _fixes(bag: Bag, topic: Topic, notes: list[str]) -> Readings:
    """Positions of satellite fixes relative to the first fix (east, north, up) [m], with NaN
    quaternions.
    """
    from pymap3d import geodetic2enu

    def numbers(fix: Any) -> tuple[float, ...]:
        return fix.latitude, fix.longitude, fix.altitude, fix.status.status

    fixes = bag.table(topic.name, numbers)
    table = fixes.values
    # receivers start with zeros
    there = (np.abs(table[:, :2]) <= [90, 360]).all(axis=1) & table[:, :2].any(axis=1)
    fixed = np.asarray((table[:, 3] >= _NO_FIX) & there)
    if not fixed.any():
        raise LogError(
            f"{bag.path}: topic {topic.name}: none of its {len(fixed)} messages has a fix"
        )
    if not fixed.all():
        notes.append(
            f"topic {topic.name}: {(~fixed).sum()} of {len(fixed)} messages left out: they have "
            "no fix"
        )
    latitude, longitude, altitude, _ = table[fixed].T
    altitude = np.where(np.abs(altitude) <= _MAX_ALTITUDE, altitude, 0.0)
    enu = geodetic2enu(latitude, longitude, altitude, latitude[0], longitude[0], altitude[0])
    return replace(
        fixes.take(fixed), values=np.column_stack([*enu, np.full((len(latitude), 4), np.nan)])
    )


def _headings(name: str, poses: Array, notes: list[str]) -> Array:
    """Headings (N,) of poses (N, 7), NaN where not measured; invalid headings are also NaN, with a
    line in `notes`.
    """
    place, turn = poses[:, :2], poses[:, 3:]
    heading = np.full(len(poses), np.nan)
    if np.isnan(turn).all():
        return heading
    good = are_unit(turn)
    if good.mean() <= 0.5:
        notes.append(
            f"{name}: most of its quaternions are not of unit length: read without headings"
        )
        return heading
    heading[good] = headings(turn[good], name, notes)
    known = heading[np.isfinite(heading)]
    placed = np.isfinite(place[:, 0])
    moves = not placed.any() or np.ptp(place[placed], axis=0).max() > _MIN_EXTENT
    if len(known) and np.ptp(known) == 0 and moves:
        notes.append(f"{name}: its heading never changes: read without headings")
        heading[:] = np.nan
    return heading


def headings(quaternion: Array, source: str, notes: list[str]) -> Array:
    """Headings (n,) of the x axes of quaternions (n, 4), counter-clockwise seen from above [rad].

    All headings are NaN if most rotations are tilted too much. Adds a line to `notes` for tilts
    above 20°.
    """
    heading, tilt = heading_and_tilt(Rotation.from_quat(quaternion))
    steep = tilt > MAX_TILT
    if not steep.any():
        return heading
    most = f"{np.degrees(tilt.max()):.0f}°"
    tilted = f"tilted by more than 20° in {int(steep.sum())} of {len(tilt)} poses, by up to {most}"
    if steep.mean() <= 0.5:
        notes.append(f"{source}: {tilted}: slip is identified in the plane")
        return heading
    notes.append(
        f"{source}: its frame is {tilted}: headings left out; is it a camera's frame, or has it "
        "z downwards?"
    )
    return np.full(len(heading), np.nan)


def read_imu(bag: Bag, choice: BagChoice, notes: list[str]) -> Readings | None:
    """Read a gyro's angular velocities (n, 3) about its frame's axes [rad/s]; None if the bag has
    none.

    The readings' `source` contains topic and frame. Adds a line to `notes` for an IMU without
    angular velocities.
    """
    topic = imu_topic(bag, choice)
    if topic is None:
        return None
    rates = bag.table(topic.name, _rates)
    rates = rates.take((np.abs(rates.values) <= MAX_YAW_RATE).all(axis=1))
    if len(rates.stamp) < 2 or not rates.values.any():
        notes.append(f"topic {topic.name}: it states no angular velocities: read without gyro")
        return None
    frame = bag.first(topic.name, 1)[0].content.header.frame_id
    several = (
        f", one of {len(bag.of_type(IMU))}"
        if len(bag.of_type(IMU)) > 1 and choice.imu is None
        else ""
    )
    return replace(rates.ascending(notes), source=f"{topic.name} in {frame or 'no frame'}{several}")


def _rates(imu: Any) -> tuple[float, ...]:
    """An IMU's angular velocities [rad/s]; NaN if a covariance of -1 marks them as not measured."""
    rate = imu.angular_velocity
    return (rate.x, rate.y, rate.z) if imu.angular_velocity_covariance[0] != -1 else (np.nan,) * 3


def with_gyro(log: RunLog, imu: Readings, start: int, notes: list[str]) -> tuple[RunLog, str]:
    """Add the IMU's yaw rate to a log that starts at `start` [ns]; returns the log and a
    description of the source.

    The yaw axis is the axis about which the IMU turns when headings (or, without these, sprockets)
    turn; it is z if nothing turns. If no axis follows the turns, adds a line to `notes` and returns
    the log without gyro.
    """
    # angles about the IMU's axes, and the time with readings, up to each row of the log
    time = seconds(imu.stamp, start)
    angles = cumulative_trapezoid(imu.values, time, axis=0, initial=0.0)
    step = np.diff(time)
    measured = np.append(0.0, np.cumsum(np.where(step <= _MAX_GAP, step, 0.0)))
    turned = np.stack([np.interp(log.time, time, angle) for angle in angles.T])
    known = np.interp(log.time, time, measured)

    yaw = yaw_axis(log, turned)
    if yaw is None:
        notes.append(f"gyro of {imu.source} left out: it doesn't follow the robot's turns")
        return log, ""

    # mean rates between rows, where they were measured
    between = np.diff(log.time)
    rate = np.diff(yaw.axis @ turned) / between
    share = np.diff(known) / between
    good = (share >= MEASURED) & (np.abs(rate) <= MAX_YAW_RATE)
    gyro = np.append(np.nan, np.where(good, rate, np.nan))

    about = log.metadata["bag"] | {"gyro": imu.source}
    shown = np.array2string(yaw.axis, precision=2, suppress_small=True)
    words = f"; gyro: {imu.source} about {shown} ({'by the turns' if yaw.found else 'assumed'})"
    return replace(log, gyro=gyro, metadata=log.metadata | {"bag": about}), words
