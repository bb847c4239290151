"""Motion in the plane: rotations, poses and arcs in the group SE(2).

On the last axis, vectors are (x, y), poses (x, y, phi), and motions at constant velocity (forward,
left, turn). Other axes broadcast. Headings and turns are not wrapped.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackslip.errors import require_finite

Array = NDArray[np.floating[Any]]

# turn below which a series is used instead of a difference of nearly equal numbers [rad]
_SMALL_TURN = 0.03


@dataclass(frozen=True)
class Mounting:
    """Position and heading of a sensor on the robot, relative to the robot's turning centre."""

    x: float = 0.0
    """Distance ahead of the turning centre [m]."""
    y: float = 0.0
    """Distance to the left of the turning centre [m]."""
    yaw: float = 0.0
    """Heading of the sensor minus heading of the robot, counter-clockwise [rad]."""

    def __post_init__(self) -> None:
        for name in ("x", "y", "yaw"):
            require_finite(f"sensor.{name}", getattr(self, name))

    @property
    def pose(self) -> Array:
        """The sensor's pose (3,) in the robot's frame [m, m, rad]."""
        return np.array([self.x, self.y, self.yaw])


def wrap_angle(angle: ArrayLike) -> Array:
    """Wrap angles (...) to [-pi, pi) [rad]."""
    return (np.asarray(angle, float) + np.pi) % (2 * np.pi) - np.pi


def direction(heading: ArrayLike) -> Array:
    """Unit vectors (..., 2) in the directions `heading` (...) [rad]."""
    return _columns(np.cos(heading), np.sin(heading))


def rotate(angle: ArrayLike, vector: ArrayLike) -> Array:
    """Rotate vectors (..., 2) by `angle` (...) [rad]."""
    vector = np.asarray(vector, float)
    return _columns(*_turned(angle, vector[..., 0], vector[..., 1]))


def to_world(frame: ArrayLike, points: ArrayLike) -> Array:
    """Convert points (..., 2) from frames with poses (..., 3) to the world frame."""
    frame, points = np.asarray(frame, float), np.asarray(points, float)
    x, y = _turned(frame[..., 2], points[..., 0], points[..., 1])
    return _columns(frame[..., 0] + x, frame[..., 1] + y)


def from_world(frame: ArrayLike, points: ArrayLike) -> Array:
    """Convert points (..., 2) from the world frame to frames with poses (..., 3)."""
    frame, points = np.asarray(frame, float), np.asarray(points, float)
    return _columns(
        *_turned(-frame[..., 2], points[..., 0] - frame[..., 0], points[..., 1] - frame[..., 1])
    )


def compose(frame: ArrayLike, pose: ArrayLike) -> Array:
    """Convert poses (..., 3) from frames with poses `frame` (..., 3) to the world frame."""
    frame, pose = np.asarray(frame, float), np.asarray(pose, float)
    x, y = _turned(frame[..., 2], pose[..., 0], pose[..., 1])
    return _columns(frame[..., 0] + x, frame[..., 1] + y, frame[..., 2] + pose[..., 2])


def between(frame: ArrayLike, pose: ArrayLike) -> Array:
    """Convert poses (..., 3) from the world frame to frames with poses `frame` (..., 3): the
    inverse of `compose`.
    """
    frame, pose = np.asarray(frame, float), np.asarray(pose, float)
    local = pose - frame
    local[..., 0], local[..., 1] = _turned(-frame[..., 2], local[..., 0], local[..., 1])
    return local


def _turned(angle: ArrayLike, x: Array, y: Array) -> tuple[Array, Array]:
    cos, sin = np.cos(angle), np.sin(angle)
    return cos * x - sin * y, sin * x + cos * y


def _columns(*parts: Any) -> Array:
    """Stack arrays (...) along a new last axis like np.stack, but faster for few numbers."""
    stacked = np.empty((*np.broadcast(*parts).shape, len(parts)))
    for k, part in enumerate(parts):
        stacked[..., k] = part
    return stacked


def inverse(pose: ArrayLike) -> Array:
    """Poses (..., 3) of the world frame, expressed in frames with poses `pose` (..., 3)."""
    return between(pose, np.zeros(3))


def chain(start: ArrayLike, steps: ArrayLike) -> Array:
    """Poses (T, 3) from the first pose (3,) and steps (T - 1, 3), each in the frame of the previous
    pose.
    """
    start, steps = np.asarray(start, float), np.asarray(steps, float)
    heading = start[2] + np.append(0.0, np.cumsum(steps[:, 2]))
    way = np.cumsum(rotate(heading[:-1], steps[:, :2]), axis=0)
    return np.column_stack([start[:2] + np.concatenate([np.zeros((1, 2)), way]), heading])


def steps(pose: Array) -> Array:
    """Steps (T - 1, 3) between poses (T, 3), each in the frame of the previous pose: the inverse of
    `chain`.
    """
    return between(pose[:-1], pose[1:])


def exp(motion: ArrayLike) -> Array:
    """Poses (..., 3) reached from the origin by motions (..., 3) along arcs."""
    motion = np.asarray(motion, float)
    turn = motion[..., 2]
    return np.concatenate(
        [_chord(turn)[..., None] * rotate(turn / 2, motion[..., :2]), motion[..., 2:]], axis=-1
    )


def log(pose: ArrayLike) -> Array:
    """Motions (..., 3) from the origin to poses (..., 3): the inverse of `exp` for turns below 2
    pi.
    """
    pose = np.asarray(pose, float)
    turn = pose[..., 2]
    return np.concatenate(
        [rotate(-turn / 2, pose[..., :2]) / _chord(turn)[..., None], pose[..., 2:]], axis=-1
    )


def drive(pose: ArrayLike, motion: ArrayLike) -> tuple[Array, Array, Array]:
    """Poses (..., 3) after motions (..., 3) from poses (..., 3), and their derivatives (..., 3, 3)
    by pose and motion.

    The rows of the derivatives are components of the final poses.
    """
    pose, motion = np.broadcast_arrays(np.asarray(pose, float), np.asarray(motion, float))
    along, across, d_along, d_across = arc_quotients(motion[..., 2])
    quotients = np.stack(
        [np.stack([along, across], axis=-1), np.stack([d_along, d_across], axis=-1)], axis=-2
    )
    # displacement per unit forwards, and its derivative by the turn
    ahead = rotate(pose[..., None, 2], quotients)
    left = ahead[..., ::-1] * np.array([-1.0, 1.0])
    way, slope = np.moveaxis(motion[..., None, :1] * ahead + motion[..., None, 1:2] * left, -2, 0)
    by_pose, by_motion = (np.zeros((*pose.shape, 3)) for _ in range(2))
    by_pose[...] = np.eye(3)
    by_pose[..., 0, 2], by_pose[..., 1, 2] = -way[..., 1], way[..., 0]
    by_motion[..., :2, 0], by_motion[..., :2, 1], by_motion[..., :2, 2] = (
        ahead[..., 0, :],
        left[..., 0, :],
        slope,
    )
    by_motion[..., 2, 2] = 1.0
    return (
        np.concatenate([pose[..., :2] + way, pose[..., 2:] + motion[..., 2:]], axis=-1),
        by_pose,
        by_motion,
    )


def advance(pose: ArrayLike, twist: ArrayLike, duration: ArrayLike) -> Array:
    """Poses (..., 3) after driving constant twists (v, w) (..., 2) for `duration` (...) [s] along
    arcs; Eqs. 6-7.
    """
    pose, twist = np.asarray(pose, float), np.asarray(twist, float)
    turn = twist[..., 1] * duration
    chord = twist[..., 0] * duration * _chord(turn)
    heading = pose[..., 2] + turn / 2
    x, y = pose[..., 0] + chord * np.cos(heading), pose[..., 1] + chord * np.sin(heading)
    return _columns(x, y, pose[..., 2] + turn)


def _chord(turn: ArrayLike) -> Array:
    """Ratios (...) of chord to length of arcs with turns (...) [rad]."""
    return np.sinc(np.asarray(turn) / (2 * np.pi))


def arc_quotients(turn: ArrayLike) -> tuple[Array, Array, Array, Array]:
    """Values of sin(t) / t and (1 - cos t) / t for turns t (...) [rad], followed by their
    derivatives.
    """
    turn = np.asarray(turn, float)
    along, across = np.sinc(turn / np.pi), np.sin(turn / 2) * _chord(turn)
    divisor = np.where(turn == 0, 1.0, turn)
    small = np.abs(turn) < _SMALL_TURN
    d_along = np.where(
        small, turn * (-1 / 3 + turn**2 / 30 - turn**4 / 840), (np.cos(turn) - along) / divisor
    )
    d_across = np.where(small, 0.5 - turn**2 / 8 + turn**4 / 144, (np.sin(turn) - across) / divisor)
    return along, across, d_along, d_across
