"""Motion in the plane: rotations, poses and arcs in the group SE(2).

On the last axis, vectors are (x, y), poses (x, y, phi), and motions at constant velocity (forward,
left, turn). Other axes broadcast. Headings and turns are not wrapped.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trackslip.errors import require_finite

Array = NDArray[np.floating[Any]]

# turn below which `arc_quotients` uses series; the first terms left out are below 2e-13 there [rad]
_SMALL_TURN: Final = 0.03


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
    x, y = _turned(angle, vector[..., 0], vector[..., 1])
    return _columns(x, y)


def to_world(frame: ArrayLike, points: ArrayLike) -> Array:
    """Convert points (..., 2) from frames with poses (..., 3) to the world frame."""
    frame = np.asarray(frame, float)
    points = np.asarray(points, float)
    x, y = _turned(frame[..., 2], points[..., 0], points[..., 1])
    return _columns(frame[..., 0] + x, frame[..., 1] + y)


def from_world(frame: ArrayLike, points: ArrayLike) -> Array:
    """Convert points (..., 2) from the world frame to frames with poses (..., 3)."""
    frame = np.asarray(frame, float)
    points = np.asarray(points, float)
    from_origin_x = points[..., 0] - frame[..., 0]
    from_origin_y = points[..., 1] - frame[..., 1]
    x, y = _turned(-frame[..., 2], from_origin_x, from_origin_y)
    return _columns(x, y)


def compose(frame: ArrayLike, pose: ArrayLike) -> Array:
    """Convert poses (..., 3) from frames with poses `frame` (..., 3) to the world frame."""
    frame = np.asarray(frame, float)
    pose = np.asarray(pose, float)
    x, y = _turned(frame[..., 2], pose[..., 0], pose[..., 1])
    return _columns(frame[..., 0] + x, frame[..., 1] + y, frame[..., 2] + pose[..., 2])


def between(frame: ArrayLike, pose: ArrayLike) -> Array:
    """Convert poses (..., 3) from the world frame to frames with poses `frame` (..., 3): the
    inverse of `compose`.
    """
    frame = np.asarray(frame, float)
    pose = np.asarray(pose, float)
    local = pose - frame
    x, y = _turned(-frame[..., 2], local[..., 0], local[..., 1])
    local[..., 0] = x
    local[..., 1] = y
    return local


def _turned(angle: ArrayLike, x: Array, y: Array) -> tuple[Array, Array]:
    """Components x and y, each (...), of vectors (x, y) rotated by `angle` (...) [rad]."""
    cos = np.cos(angle)
    sin = np.sin(angle)
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
    start = np.asarray(start, float)
    steps = np.asarray(steps, float)
    heading = start[2] + np.append(0.0, np.cumsum(steps[:, 2]))
    displacement = np.cumsum(rotate(heading[:-1], steps[:, :2]), axis=0)
    position = start[:2] + np.concatenate([np.zeros((1, 2)), displacement])
    return np.column_stack([position, heading])


def steps(pose: Array) -> Array:
    """Steps (T - 1, 3) between poses (T, 3), each in the frame of the previous pose: the inverse of
    `chain`.
    """
    return between(pose[:-1], pose[1:])


def exp(motion: ArrayLike) -> Array:
    """Poses (..., 3) reached from the origin by motions (..., 3) along arcs.

    The chord of an arc is parallel to the velocity in the middle of the arc.
    """
    motion = np.asarray(motion, float)
    turn = motion[..., 2]
    chord = _chord(turn)[..., None] * rotate(turn / 2, motion[..., :2])
    return np.concatenate([chord, motion[..., 2:]], axis=-1)


def log(pose: ArrayLike) -> Array:
    """Motions (..., 3) from the origin to poses (..., 3): the inverse of `exp` for turns below 2
    pi.
    """
    pose = np.asarray(pose, float)
    turn = pose[..., 2]
    arc = rotate(-turn / 2, pose[..., :2]) / _chord(turn)[..., None]
    return np.concatenate([arc, pose[..., 2:]], axis=-1)


def drive(pose: ArrayLike, motion: ArrayLike) -> tuple[Array, Array, Array]:
    """Poses (..., 3) after motions (..., 3) from poses (..., 3), and their derivatives (..., 3, 3)
    by pose and motion.

    A motion (f, l, t) at constant velocity, forwards, to the left and in turn, takes a robot from
    (x, y, phi) to (x + d_x, y + d_y, phi + t). With the quotients s = sin(t) / t and c = (1 -
    cos(t)) / t, a unit forwards displaces it by a, and a unit to the left by a turned left:

        a_x = s cos(phi) - c sin(phi)        d_x = f a_x - l a_y
        a_y = s sin(phi) + c cos(phi)        d_y = f a_y + l a_x

    So the derivatives of (d_x, d_y) are

        by f    ( a_x, a_y)
        by l    (-a_y, a_x)
        by t    as above, with s and c replaced by their derivatives
        by phi  (-d_y, d_x)

    The rows of the derivatives are components of the final poses, the columns those of the pose
    or motion.
    """
    pose, motion = np.broadcast_arrays(np.asarray(pose, float), np.asarray(motion, float))
    heading = pose[..., 2]
    forwards = motion[..., 0]
    leftwards = motion[..., 1]
    turn = motion[..., 2]

    # displacement by a unit forwards, and its derivative by the turn
    along, across, along_slope, across_slope = arc_quotients(turn)
    unit_x, unit_y = _turned(heading, along, across)
    slope_x, slope_y = _turned(heading, along_slope, across_slope)
    shift_x = forwards * unit_x - leftwards * unit_y
    shift_y = forwards * unit_y + leftwards * unit_x
    after = _columns(pose[..., 0] + shift_x, pose[..., 1] + shift_y, heading + turn)

    by_pose = np.zeros((*pose.shape, 3))
    by_pose[...] = np.eye(3)
    by_pose[..., 0, 2] = -shift_y
    by_pose[..., 1, 2] = shift_x

    by_motion = np.zeros((*pose.shape, 3))
    # by the distance forwards
    by_motion[..., 0, 0] = unit_x
    by_motion[..., 1, 0] = unit_y
    # by the distance to the left
    by_motion[..., 0, 1] = -unit_y
    by_motion[..., 1, 1] = unit_x
    # by the turn
    by_motion[..., 0, 2] = forwards * slope_x - leftwards * slope_y
    by_motion[..., 1, 2] = forwards * slope_y + leftwards * slope_x
    by_motion[..., 2, 2] = 1.0
    return after, by_pose, by_motion


def advance(pose: ArrayLike, twist: ArrayLike, duration: ArrayLike) -> Array:
    """Poses (..., 3) after driving constant twists (v, w) (..., 2) for `duration` (...) [s] along
    arcs; Eqs. 6-7.
    """
    pose = np.asarray(pose, float)
    twist = np.asarray(twist, float)
    turn = twist[..., 1] * duration
    chord = twist[..., 0] * duration * _chord(turn)
    middle_heading = pose[..., 2] + turn / 2
    x = pose[..., 0] + chord * np.cos(middle_heading)
    y = pose[..., 1] + chord * np.sin(middle_heading)
    return _columns(x, y, pose[..., 2] + turn)


def _chord(turn: ArrayLike) -> Array:
    """Ratios (...) of chord to length of arcs with turns (...) [rad]: sin(t / 2) / (t / 2)."""
    return np.sinc(np.asarray(turn) / (2 * np.pi))


def arc_quotients(turn: ArrayLike) -> tuple[Array, Array, Array, Array]:
    """Values s = sin(t) / t and c = (1 - cos(t)) / t for turns t (...) [rad], and their
    derivatives, each (...).

    An arc of length 1 leads to (s, c), ahead and to the left. The derivatives are

        s' = (cos(t) - s) / t = -t / 3 + t^3 / 30 - t^5 / 840 + ...
        c' = (sin(t) - c) / t = 1 / 2 - t^2 / 8 + t^4 / 144 - ...

    Near 0 the quotients are differences of nearly equal numbers, so the series replace them.
    """
    turn = np.asarray(turn, float)
    along = np.sinc(turn / np.pi)
    across = np.sin(turn / 2) * _chord(turn)  # 1 - cos(t) = 2 sin(t / 2)^2

    is_small = np.abs(turn) < _SMALL_TURN
    divisor = np.where(turn == 0, 1.0, turn)
    along_series = turn * (-1 / 3 + turn**2 / 30 - turn**4 / 840)
    across_series = 0.5 - turn**2 / 8 + turn**4 / 144
    along_slope = np.where(is_small, along_series, (np.cos(turn) - along) / divisor)
    across_slope = np.where(is_small, across_series, (np.sin(turn) - across) / divisor)
    return along, across, along_slope, across_slope
