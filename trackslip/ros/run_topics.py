"""What a run looks like to ROS: the topics that a robot, its localization and a scanner beside the field publish."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from trackslip.errors import InvalidValueError, require
from trackslip.kinematics import Array, RobotGeometry, advance, body_twist
from trackslip.localization.scan import Scan
from trackslip.logs.runlog import RunLog
from trackslip.ros.datum import Datum
from trackslip.ros.messages import Messages, Stamps, Topic

PoseMessage = Literal["PoseWithCovarianceStamped", "PoseStamped", "Odometry"]
"""Message types of poses, as SLAM, motion capture and visual odometry publish them."""
POSE_TOPICS: dict[PoseMessage, str] = {
    "PoseWithCovarianceStamped": "/pose",
    "PoseStamped": "/pose",
    "Odometry": "/visual_odometry",
}
"""Their topics."""
JOINTS = ("left_sprocket", "right_sprocket")
"""Names of the sprockets in /joint_states."""
_LAST = 2**31 - 1  # of the seconds in a stamp
# Of x, y [m^2] and yaw [rad^2], and of their rates, as configurations of diff_drive_controller commonly state them.
_WHEEL_COVARIANCE = np.diag([0.001, 0.001, 0.01])
_UNKNOWN = 1e6 * np.eye(3)  # covariance of a twist that isn't measured


class RunTopics:
    """The topics of a log, group by group; empty where the log doesn't have them."""

    def __init__(self, log: RunLog, geometry: RobotGeometry | None, start: int, readings: np.ndarray | None) -> None:
        """Stamps are `start` [s] later than the log's times; `readings` (T,) marks rows of the encoders, None for all.

        Raises TrackslipError where rosbags is missing.
        """
        self._make = Messages()
        self._log, self._geometry, self._start = log, geometry, start
        self._read = np.ones(len(log.time), bool) if readings is None else np.asarray(readings, bool)
        self._odom = None if geometry is None else _reckoned(log, geometry)

    def encoders(self) -> Iterator[Topic]:
        """What the sprockets have done."""
        log, read, make = self._log, self._read, self._make
        stamps = self._stamps(log.time[read])
        turned = log.omega[1:] * np.diff(log.time)[:, None]
        angle = np.concatenate([np.zeros((1, 2)), np.cumsum(turned, axis=0)])
        yield make.joint_states("/joint_states", stamps, JOINTS, angle[read], log.omega[read])
        if self._geometry is not None and self._odom is not None:
            twist = _planar(body_twist(log.omega[read], 0.0, self._geometry))
            frames, errors = ("odom", "base_link"), _WHEEL_COVARIANCE
            yield make.odometry("/odom", stamps, frames, self._odom[read], errors, twist, errors)
            yield make.transforms("/tf", stamps, frames, self._odom[read])

    def commands(self) -> Iterator[Topic]:
        """The body twists commanded by a controller, or meant by the sprocket speeds commanded, as if nothing slips."""
        log, twist = self._log, self._log.twist_command
        if twist is None and log.command is not None and self._geometry is not None:
            twist = body_twist(log.command, 0.0, self._geometry)
        if twist is not None:
            given = self._read & np.isfinite(twist).all(axis=1)
            yield self._make.twists("/cmd_vel", self._stamps(log.time[given]), "base_link", _planar(twist[given]))

    def poses(self, kind: PoseMessage, covariance: Array | None) -> Iterator[Topic]:
        """The measured poses, and what localization makes of them."""
        log, make = self._log, self._make
        errors = np.zeros((3, 3)) if covariance is None else np.asarray(covariance, float)
        require(errors.shape == (3, 3), "covariance", errors.shape, "of shape (3, 3)")
        errors = np.broadcast_to(errors, (len(log.time), 3, 3))
        if log.covariance is not None:
            errors = np.where(np.isfinite(log.covariance).all(axis=(1, 2), keepdims=True), log.covariance, errors)
        headed = log.has_heading
        rest = log.is_valid & ~headed
        if headed.any():
            stamps, pose, name = self._stamps(log.time[headed]), log.pose[headed], POSE_TOPICS[kind]
            if kind == "PoseStamped":
                yield make.poses(name, stamps, "map", pose)
            elif kind == "Odometry":
                still, frames = np.zeros_like(pose), ("visual_odom", "base_link")
                yield make.odometry(name, stamps, frames, pose, errors[headed], still, _UNKNOWN)
            else:
                yield make.poses_with_covariance(name, stamps, "map", pose, errors[headed])
                if self._odom is not None:
                    yield make.transforms("/tf", stamps, ("map", "odom"), _between(pose, self._odom[headed]))
        if rest.any():
            place = Datum().geodetic(log.pose[rest, :2])
            horizontal = errors[rest] * np.array([1.0, 1.0, 0.0]) * np.array([[1.0], [1.0], [0.0]])
            yield make.fixes("/fix", self._stamps(log.time[rest]), "gnss", place, horizontal)

    def truth(self) -> Iterator[Topic]:
        """The true motion."""
        log, read = self._log, self._read
        if log.truth is not None:
            stamps, exact = self._stamps(log.time[read]), np.zeros((3, 3))
            pose, twist = log.truth.pose[read], log.truth.twist[read]
            yield self._make.odometry("/ground_truth", stamps, ("map", "base_link"), pose, exact, twist, exact)

    def scans(self, scans: tuple[Array, Scan] | None, duration: float) -> Iterator[Topic]:
        """The scans, and where the scanner is."""
        if scans is None or not len(scans[0]):
            return
        time, scan = scans
        require(len(time) == len(scan.ranges), "scans", f"{len(time)} times", f"{len(scan.ranges)}, one per scan")
        require((np.diff(time) > 0).all(), "scans", "times that don't ascend", "in order of time")
        require(len(scan.bearings) > 1, "scans", f"{len(scan.bearings)} beams", "scans of at least 2")
        period = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
        yield self._make.scans("/scan", self._stamps(time - duration / 2), "laser", scan, duration, period)
        begin = self._stamps(np.minimum(time[:1] - duration / 2, self._log.time[0]))
        mount = np.asarray(scan.mount, float)[None]
        yield self._make.transforms("/tf_static", begin, ("map", "laser"), mount, latched=True)

    def _stamps(self, time: Array) -> Stamps:
        """Stamps (M,) [ns] of times (M,) [s]."""
        whole = np.floor(time)
        if time.size and not (whole.min() + self._start >= 0 and whole.max() + self._start < _LAST):
            raise InvalidValueError("start", self._start, f"such that all stamps are from 0 to {_LAST} s")
        parts = np.rint((time - whole) * 1e9).astype(np.int64)
        return (whole.astype(np.int64) + self._start) * 10**9 + parts


def own_scans(log: RunLog) -> tuple[Array, Scan] | None:
    """The scans of the log's rows, if it has them in full."""
    if log.scans is None or log.scans.full is None:
        return None
    return log.time, replace(log.scans.scan, ranges=log.scans.full)


def stated_scan_duration(log: RunLog) -> float:
    """Time from a scan's first beam to its last [s], of the scanner in the metadata of a run; 0 if there is none."""
    scanner = log.metadata.get("scanner")
    duration = scanner.get("scan_duration") if isinstance(scanner, Mapping) else None
    return float(duration) if isinstance(duration, int | float) else 0.0


def _reckoned(log: RunLog, geometry: RobotGeometry) -> Array:
    """Poses (T, 3) by dead reckoning without slip, from (0, 0, 0)."""
    twist = body_twist(log.omega[1:], 0.0, geometry)
    steps = advance(np.zeros((len(twist), 3)), twist, np.diff(log.time))
    heading = np.concatenate([[0.0], np.cumsum(steps[:, 2])])
    ahead = (steps[:, 0] + 1j * steps[:, 1]) * np.exp(1j * heading[:-1])
    place = np.concatenate([[0.0], np.cumsum(ahead)])
    return np.stack([place.real, place.imag, heading], axis=-1)


def _between(outer: Array, inner: Array) -> Array:
    """Poses (M, 3) of the frame in which a robot at `outer` (M, 3) is at `inner` (M, 3)."""
    turn = outer[:, 2] - inner[:, 2]
    place = outer[:, 0] + 1j * outer[:, 1] - (inner[:, 0] + 1j * inner[:, 1]) * np.exp(1j * turn)
    return np.stack([place.real, place.imag, turn], axis=-1)


def _planar(twist: Array) -> Array:
    """Twists (M, 3), forward, to the left and yaw, of those without lateral speed (M, 2)."""
    return np.insert(twist, 1, 0.0, axis=1)
