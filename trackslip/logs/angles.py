"""Angles of the sprockets from what encoders state: counters and angles that wrap, and odometry.

An angle that was read is exact whatever happened since the reading before it. Speeds are therefore
means between readings, and their integral over a drive is the difference of the angles.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from enum import Enum
from typing import Final

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array, RobotGeometry, track_speeds
from trackslip.se2 import wrap_angle

# margin by which wrapped angles may leave their range because of rounding [rad]
_ROUNDING: Final = 0.01
# ratio to the steps before and after it above which a step is no motion [-]
_STANDS_OUT: Final = 5.0
_NEIGHBOURS: Final = 5  # number of steps before, and after, that a step is compared with
_SLACK: Final = 2.0  # ticks by which steps across a wrap may differ from their neighbours
COUNTERS: Final = tuple(2.0**bits for bits in range(8, 33))
"""Numbers of different values that counters have: 8 to 32 bits."""
_NO_TURN: Final = 1e-6  # turn below which an arc is a straight line [rad]


class EncoderKind(Enum):
    """What a table states about the sprockets: the names of its columns."""

    SPEEDS = ("omega_l", "omega_r")
    ANGLES = ("angle_l", "angle_r")
    TICKS = ("ticks_l", "ticks_r")
    ODOMETRY_POSES = ("odom_x", "odom_y", "odom_phi")
    ODOMETRY_TWISTS = ("odom_v", "odom_w")

    @property
    def is_cumulative(self) -> bool:
        """True if readings are angles or positions, not speeds."""
        return self not in (EncoderKind.SPEEDS, EncoderKind.ODOMETRY_TWISTS)

    @property
    def is_odometry(self) -> bool:
        """True if readings are the odometry's, for one geometry."""
        return self in (EncoderKind.ODOMETRY_POSES, EncoderKind.ODOMETRY_TWISTS)


def encoder_kind(present: Collection[str]) -> EncoderKind | None:
    """The kind of readings in a table with the columns `present`, or None without any.

    Raises LogError for several kinds, and for a kind of which a column is missing.
    """
    kinds = [kind for kind in EncoderKind if not set(kind.value).isdisjoint(present)]
    if not kinds:
        return None
    if len(kinds) > 1:
        both = " and ".join(", ".join(kind.value) for kind in kinds)
        raise LogError(f"columns {both} are {len(kinds)} kinds of encoder readings: keep one")
    (kind,) = kinds
    missing = [name for name in kind.value if name not in present]
    if missing:
        given = [name for name in kind.value if name in present]
        raise LogError(f"has no column {', '.join(missing)} beside {', '.join(given)}")
    return kind


def mean_speeds(time: Array, angles: Array) -> Array:
    """Speeds (n, 2), means since the previous reading, from angles (n, 2) at times (n,); the first
    equals the second.
    """
    speeds = np.diff(angles, axis=0) / np.diff(time)[:, None]
    return np.concatenate([speeds[:1], speeds])


def odometry_speeds(twist: Array, geometry: RobotGeometry) -> Array:
    """Sprocket speeds (n, 2) [rad/s] from which odometry with `geometry` computed twists (n, 2)."""
    return track_speeds(twist, geometry.half_gauge) / geometry.sprocket_radius


def odometry_angles(pose: Array, geometry: RobotGeometry) -> Array:
    """Angles (n, 2) of the sprockets since the first pose [rad], from which odometry with
    `geometry` computed poses (n, 3).

    From pose to pose a differential drive moves on an arc. Its chord points to the heading midway
    between both poses, and an arc that turns by δ is longer than its chord by (δ/2) / sin(δ/2).
    With the length s of the arc, the tracks have moved by s -+ b δ.

    The chord is measured along that heading, not by its size: rounded positions move aside, too,
    which would lengthen each step, whereas errors along the heading cancel from step to step.
    """
    turn = wrap_angle(np.diff(pose[:, 2]))
    midway = pose[:-1, 2] + turn / 2
    step = np.diff(pose[:, :2], axis=0)
    chord = step[:, 0] * np.cos(midway) + step[:, 1] * np.sin(midway)

    turns = np.abs(turn) > _NO_TURN
    half = np.where(turns, turn / 2, 1.0)
    length = chord * np.where(turns, half / np.sin(half), 1.0)

    moved = track_speeds(np.column_stack([length, turn]), geometry.half_gauge)
    steps = moved / geometry.sprocket_radius
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def odometry_jump(time: Array, pose: Array) -> tuple[int, float] | None:
    """The row to which poses (n, 3) of odometry at times (n,) jump, as when it is reset, and the
    distance [m]; None if they don't.
    """
    step = np.diff(pose[:, :2], axis=0)
    distance = np.hypot(step[:, 0], step[:, 1])
    driven = np.append(0.0, np.cumsum(distance))
    _, row = continuous(time, 1e3 * driven, ())  # in steps of a millimetre
    return None if row is None else (row, float(distance[row - 1]))


def unwrapped_angle(angle: Array) -> Array:
    """Continuous angles (n,) [rad]: angles within -π to π or 0 to 2π are unwrapped."""
    low = angle.min()
    high = angle.max()
    wraps = any(
        start - _ROUNDING <= low and high <= start + 2 * np.pi + _ROUNDING
        for start in (-np.pi, 0.0)
    )
    return np.unwrap(angle) if wraps else angle


def continuous(
    time: Array, counts: Array, sizes: Sequence[float] = COUNTERS
) -> tuple[Array, int | None]:
    """Counts (n,) at times (n,) without the jumps of a counter that wraps; and the row in which the
    counter restarts, or None.

    A counter of M values jumps by M. M is one of `sizes` or, if the counter wraps at least twice,
    the jump that all wraps have in common.
    """
    if len(counts) < 3:
        return counts, None
    for size in sizes:
        unwound = _of_size(time, counts, size)
        if unwound is not None:
            return unwound, None

    jumps = np.flatnonzero(_stand_out(time, counts))
    if not jumps.size:
        return counts, None
    size_of_all = _common_jump(time, counts, jumps)
    if size_of_all is None:
        return counts, int(jumps[0]) + 1
    return np.unwrap(counts, period=size_of_all), None


def _of_size(time: Array, counts: Array, size: float) -> Array | None:
    """Counts (n,) of a counter of `size` values without its jumps; None if they aren't, or don't
    jump.
    """
    step = np.abs(np.diff(counts))
    moving = step[step > 0]
    jumps = step > size / 2
    if np.ptp(counts) > size + _SLACK or not jumps.any() or np.median(moving) > size / 4:
        return None
    unwound = np.unwrap(counts, period=size)
    # a counter that restarts jumps by another number
    return None if (jumps & _stand_out(time, unwound)).any() else unwound


def _common_jump(time: Array, counts: Array, jumps: np.ndarray) -> float | None:
    """The jump that a counter makes at all of its steps `jumps` (j,); None if these differ, or for
    a single one.

    A step across a wrap is the jump plus some motion, about that of the steps before and after it.
    Sizes are round numbers of ticks more often than not.
    """
    step = np.diff(counts)
    rate = step / np.diff(time)
    before = rate[np.maximum(jumps - 1, 0)]
    after = rate[np.minimum(jumps + 1, len(rate) - 1)]
    interval = np.diff(time)[jumps]
    motion = (before + after) / 2 * interval
    doubt = float(np.median(np.abs(after - before) / 2 * interval)) + _SLACK
    sizes = np.abs(step[jumps] - motion)
    slack = _usual_steps(time, step)[jumps] + _SLACK
    size = float(np.median(sizes))
    span = float(np.ptp(counts))
    if len(jumps) < 2 or (np.abs(sizes - size) > slack).any() or span > size + slack.max():
        return None
    for unit in (1000.0, 100.0, 10.0):
        rounded = unit * round(size / unit)
        if abs(rounded - size) <= doubt and rounded > span:
            return rounded
    return float(round(max(size, span + 1)))


def _stand_out(time: Array, counts: Array) -> np.ndarray:
    """(n - 1,) bool: true for steps of counts (n,) at times (n,) that are far larger than the
    motion around them.
    """
    step = np.diff(counts)
    usual = _usual_steps(time, step)
    return np.asarray((usual > 0) & (np.abs(step) > _STANDS_OUT * usual + _SLACK))


def _usual_steps(time: Array, step: Array) -> Array:
    """Sizes (m,) that steps (m,) have at the largest rate of the steps before and after each, and
    at least at the median rate.
    """
    # stamps may lie close together by chance
    interval = np.maximum(np.diff(time), np.median(np.diff(time)))
    rate = np.abs(step) / interval
    moving = rate[rate > 0]
    around = np.full(len(rate), np.median(moving) if moving.size else 0.0)
    for shift in range(1, min(_NEIGHBOURS, len(rate) - 1) + 1):
        around[shift:] = np.maximum(around[shift:], rate[:-shift])
        around[:-shift] = np.maximum(around[:-shift], rate[shift:])
    return around * interval
