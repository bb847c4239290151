"""Bags of a robot with a plate before a scanner, written by rosbags and by MCAP's own writer."""

from __future__ import annotations

import numpy as np
from bags import START, header, in_order, joint_states, stamp, write_bag
from beside import Session

SCAN = "sensor_msgs/msg/LaserScan"
NAMES = ("left_wheel_joint", "right_wheel_joint")


def scan_messages(session: Session, topic="/scan", frame="laser", start=START, late=2_000_000, ranges=None, **more):
    """A message for each scan."""
    made = []
    for k, time in enumerate(session.time):
        at = stamp(time, start)
        row = (session.ranges if ranges is None else ranges)[k]
        fields = {
            "header": header(at, frame),
            "angle_min": session.angle_min,
            "angle_max": session.angle_min + session.angle_increment * (len(row) - 1),
            "angle_increment": session.angle_increment,
            "time_increment": session.time_increment,
            "scan_time": 0.05,
            "range_min": 0.05,
            "range_max": 30.0,
            "ranges": row.astype(np.float32).tolist(),
            "intensities": [],
        } | more
        made.append((topic, SCAN, at + late, fields))
    return made


def joint_messages(session: Session, names=NAMES):
    """Angles of the sprockets at each reading."""
    turned = session.omega[1:] * np.diff(session.encoder_time)[:, None]
    angle = np.concatenate([np.zeros((1, 2)), np.cumsum(turned, axis=0)])
    return [joint_states(stamp(t), names, row) for t, row in zip(session.encoder_time, angle.tolist(), strict=True)]


def write_session(path, kind, session: Session, *more, **scans):
    """A bag of encoders, scans and what else is given."""
    return write_bag(path, kind, in_order(joint_messages(session), scan_messages(session, **scans), *more))
