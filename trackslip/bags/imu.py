"""The yaw rate by the gyro of an IMU in a bag, wherever it is mounted."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from trackslip.bags.choice import BagChoice
from trackslip.bags.open import Bag
from trackslip.bags.stamps import Readings, seconds
from trackslip.bags.topics import IMU, imu_topic
from trackslip.logs.checks import paired_turns
from trackslip.logs.runlog import MAX_YAW_RATE, MEASURED, RunLog

_MAX_GAP = 0.2  # longest time between readings that counts as measured [s]
_CLEARLY = 0.8  # correlation of turns that leaves no doubt [-]
_ALONG = 0.98  # component of an axis that is one of the IMU's own: it is mounted so to within 11° [-]


def read_imu(bag: Bag, choice: BagChoice, notes: list[str]) -> Readings | None:
    """The gyro's yaw rates (n, 3) about the axes of its frame [rad/s]; None without, with a note if there is an IMU.

    Their source is the topic and the frame, in words.
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
    several = f", one of {len(bag.of_type(IMU))}" if len(bag.of_type(IMU)) > 1 and choice.imu is None else ""
    return replace(rates.ascending(notes), source=f"{topic.name} in {frame or 'no frame'}{several}")


def _rates(imu: Any) -> tuple[float, ...]:
    """Its angular velocities; NaN if their covariance says, by -1, that they are not measured."""
    rate = imu.angular_velocity
    return (rate.x, rate.y, rate.z) if imu.angular_velocity_covariance[0] != -1 else (np.nan,) * 3


def with_gyro(log: RunLog, imu: Readings, start: int, notes: list[str]) -> tuple[RunLog, str]:
    """The log, whose time begins at `start` [ns], with the IMU's yaw rate, and where that is from, in words.

    Its axis is the one about which the IMU turns when headings do, or else the sprockets; without turns, z. `notes`
    gets a line if no axis follows the turns, and the log is returned without gyro.
    """
    time = seconds(imu.stamp, start)
    angle = cumulative_trapezoid(imu.values, time, axis=0, initial=0.0)
    step = np.diff(time)
    measured = np.append(0.0, np.cumsum(np.where(step <= _MAX_GAP, step, 0.0)))
    *turned, known = (np.interp(log.time, time, column) for column in (*angle.T, measured))
    turn = np.where(log.has_heading, log.pose[:, 2], np.nan)
    if not log.has_heading.any():
        turn = np.append(0.0, np.cumsum((log.omega[1:] @ [-1, 1]) * np.diff(log.time)))
    axis, why = np.array([0.0, 0.0, 1.0]), "assumed"
    paired = paired_turns(log.time, np.stack(turned), turn)
    if paired is not None:
        turns, by_axis = paired
        axis, why = by_axis @ turns / np.linalg.norm(by_axis @ turns), "by the turns"
        if np.abs(axis).max() > _ALONG:
            axis = np.where(np.abs(axis) > _ALONG, np.sign(axis), 0.0)
        if np.corrcoef(axis @ by_axis, turns)[0, 1] < _CLEARLY:
            notes.append(f"gyro of {imu.source} left out: it doesn't follow the robot's turns")
            return log, ""
    rate, share = (np.diff(values) / np.diff(log.time) for values in (axis @ np.stack(turned), known))
    gyro = np.append(np.nan, np.where((share >= MEASURED) & (np.abs(rate) <= MAX_YAW_RATE), rate, np.nan))
    about = log.metadata["bag"] | {"gyro": imu.source}
    shown = np.array2string(axis, precision=2, suppress_small=True)
    words = f"; gyro: {imu.source} about {shown} ({why})"
    return replace(log, gyro=gyro, metadata=log.metadata | {"bag": about}), words
