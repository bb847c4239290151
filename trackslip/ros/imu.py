"""The yaw rate by the gyro of an IMU in a bag, wherever it is mounted."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import cumulative_trapezoid

from trackslip.kinematics import Array
from trackslip.logs.checks import CLEARLY, paired_turns
from trackslip.logs.runlog import MAX_YAW_RATE, MEASURED, RunLog
from trackslip.ros.bag import Bag, Topic
from trackslip.ros.choice import BagChoice
from trackslip.ros.stamps import seconds, stretches
from trackslip.ros.transforms import fixed_in

IMU = "sensor_msgs/msg/Imu"
_LESSER = (
    r"camera|realsense|zed|oak|lidar|ouster|\bos\d?_|livox|velodyne|raw"  # names of IMUs taken if there is no other
)
_MAX_GAP = 0.2  # longest time between readings that counts as measured [s]
_ALONG = 0.98  # component of an axis that is one of the IMU's own [-]


@dataclass(frozen=True)
class Imu:
    """Readings of the gyro of an IMU, all by one clock."""

    source: str
    """Its topic and frame, in words."""
    stamp: np.ndarray
    """(n,) int: stamps in the headers, ascending [ns]."""
    rate: Array
    """(n, 3) about the axes of its frame [rad/s]."""
    axis: Array | None
    """(3,) upwards in its frame by static transforms; None without."""


def imu_topic(bag: Bag, choice: BagChoice) -> Topic | None:
    """The topic chosen, or the best: an IMU of its own with most messages; None without."""
    if choice.imu is not None:
        return None if choice.imu == "none" else bag.topic(choice.imu, IMU)

    def rank(topic: Topic) -> tuple[bool, int]:
        return bool(re.search(_LESSER, topic.name, re.IGNORECASE)), -topic.count

    return min(bag.of_type(IMU), key=rank, default=None)


def read_imu(bag: Bag, choice: BagChoice, notes: list[str]) -> list[Imu]:
    """The gyro's readings for each stretch between restarts of the clock; empty, with a note, if there are none."""
    topic = imu_topic(bag, choice)
    if topic is None:
        return []
    found, frame = [], ""
    for message in bag.messages(topic.name, notes=notes):
        rate, frame = message.content.angular_velocity, message.content.header.frame_id
        if message.content.angular_velocity_covariance[0] != -1:  # which stands for "not measured"
            found.append((message.stamp, message.arrival, rate.x, rate.y, rate.z))
    rates = np.array([row[2:] for row in found], float).reshape(-1, 3)
    good = (np.abs(rates) <= MAX_YAW_RATE).all(axis=1)
    if good.sum() < 2 or not rates[good].any():
        notes.append(f"topic {topic.name}: it states no angular velocities: read without gyro")
        return []
    stamp, arrival = np.array([row[:2] for row in found], np.int64)[good].T
    placed = fixed_in(bag, frame, notes, static=True)
    axis = None if placed is None else placed[2].as_matrix()[2]
    parts = stretches(topic.name, stamp, arrival, notes)
    several = f", one of {len(bag.of_type(IMU))}" if len(bag.of_type(IMU)) > 1 and choice.imu is None else ""
    source = f"{topic.name} in {frame or 'no frame'}{several}"
    return [Imu(source, stamp[rows], rates[good][rows], axis) for rows in parts]


def with_gyro(log: RunLog, imu: Imu, start: int, notes: list[str]) -> tuple[RunLog, str]:
    """The log, whose time begins at `start` [ns], with the IMU's yaw rate, and where that is from, in words.

    Its axis is that of the transforms, or the one about which the IMU turns when headings do, or else the sprockets;
    without turns, z. `notes` gets a line if no axis follows the turns, and the log is returned without gyro.
    """
    time = seconds(imu.stamp, start)
    step = np.diff(time)
    sums = np.column_stack(
        [
            cumulative_trapezoid(imu.rate, time, axis=0, initial=0.0),
            np.append(0.0, np.cumsum(np.where(step <= _MAX_GAP, step, 0.0))),
        ]
    )
    turned = np.stack([np.interp(log.time, time, column) for column in sums.T])
    turn = np.where(log.has_heading, log.pose[:, 2], np.nan)
    if not log.has_heading.any():
        turn = np.append(0.0, np.cumsum((log.omega[1:] @ [-1, 1]) * np.diff(log.time)))
    paired, axis, why = paired_turns(log.time, turned[:3], turn), imu.axis, "by transforms"
    if paired is not None:
        along = paired[1] @ paired[0]
        if axis is None or axis @ along <= 0:
            why = "by the turns" if axis is None else "by the turns, against the transforms"
            axis = along / np.linalg.norm(along)
            axis = np.where(np.abs(axis) > _ALONG, np.sign(axis), 0.0) if np.abs(axis).max() > _ALONG else axis
        if np.corrcoef(axis @ paired[1], paired[0])[0, 1] < CLEARLY:
            notes.append(f"gyro of {imu.source} left out: it doesn't follow the robot's turns")
            return log, ""
    elif axis is None:
        axis, why = np.array([0.0, 0.0, 1.0]), "assumed"
    shown = np.array2string(axis, precision=2, suppress_small=True)
    rate, measured = (np.diff(values) / np.diff(log.time) for values in (axis @ turned[:3], turned[3]))
    gyro = np.append(np.nan, np.where((measured >= MEASURED) & (np.abs(rate) <= MAX_YAW_RATE), rate, np.nan))
    about = log.metadata["bag"] | {"gyro": imu.source}
    words = f"; gyro: {imu.source} about {shown} ({why})"
    return replace(log, gyro=gyro, metadata=log.metadata | {"bag": about}), words
