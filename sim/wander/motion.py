"""Simulated drives: track speeds from a driver with one lever per track, true poses over time, and
logs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from sim.terrain.pieces import smooth_step
from trackslip import se2
from trackslip.errors import Checked, InvalidValueError, checked, require, require_positive
from trackslip.kinematics import TRACK_SIGNS, Array
from trackslip.logs.runlog import RunLog, Truth

_STEEPEST: Final = 1.5  # largest slope of the smooth step 3 u^2 - 2 u^3 from 0 to 1, at u = 1/2
# first zero of J_0: amplitude of a sinusoidal heading that closes a figure eight [rad]
_CLOSING: Final = 2.404825557695773
_BACK: Final = -0.3  # lowest position of a lever unless both reverse [share of its forward travel]
_STRAIGHT: Final = 4.0  # duration of each straight side of a loop [s]
# shares of the levers' positions that are kept, made equal, reversed and zero [-]
_KINDS: Final = (0.8, 0.08, 0.06, 0.06)
_MOSTLY_FORWARDS: Final = 0.6  # exponent of uniform numbers that favours large ones
_SHORTEST_STRETCH: Final = 4.0  # of stop and go, with its stop [s]
_ROUNDING: Final = 1e-9  # tolerance on the number of rows


@dataclass(frozen=True)
class Driver(Checked):
    """A driver's limits, and the half gauge that the driver assumes for turns."""

    max_speed: float = checked(0.3, require_positive)
    """Largest speed of a track [m/s]."""
    acceleration: float = checked(0.5, require_positive)
    """Largest acceleration of a track [m/s^2]."""
    half_gauge: float = checked(0.168, require_positive)
    """Half gauge for turns; for a robot that slips, b + D [m]."""


def track_commands(
    driving: str, duration: float, rate: float, driver: Driver, rng: np.random.Generator
) -> Array:
    """Track speeds (T, 2) [m/s] for a driving style in DRIVING, at times k / `rate` up to
    `duration` [s].

    The tracks start at rest. Raises InvalidValueError for an unknown style.
    """
    if driving not in DRIVING:
        raise InvalidValueError("driving", driving, f"one of {', '.join(DRIVING)}")
    require_positive("duration", duration)
    require_positive("rate", rate)
    rows = int(duration * rate + _ROUNDING) + 1
    allowed = f"at least a period of the encoders, {1 / rate:g} s"
    require(rows >= 2, "duration", duration, allowed)
    time = np.arange(rows) / rate
    return DRIVING[driving](time, driver, rng)


def _random(time: Array, driver: Driver, rng: np.random.Generator) -> Array:
    """Speeds (T, 2): levers move smoothly between random positions; sometimes both are equal,
    reverse or rest.
    """
    count = int(time[-1]) + 2  # enough positions, as each takes more than a second
    levers = _BACK + (1 - _BACK) * rng.random((count, 2)) ** _MOSTLY_FORWARDS
    kinds = rng.choice(4, count, p=_KINDS)[:, None]
    equal = np.broadcast_to(np.abs(levers[:, :1]), levers.shape)
    levers = np.choose(kinds, [levers, equal, -levers, 0 * levers])
    moving = rng.uniform(0.8, 1.4, count)
    holding = rng.uniform(0.5, 1.5, count)
    return _levers(time, driver, driver.max_speed * levers, moving, holding)


def _stop_and_go(time: Array, driver: Driver, rng: np.random.Generator) -> Array:
    """Speeds (T, 2) for straights and turns at constant speeds, with stops in between."""
    count = int(time[-1] / _SHORTEST_STRETCH) + 2  # enough stretches
    speed = rng.uniform(0.4, 1.0, (count, 1))
    inner = rng.uniform(0.0, 1.0, (count, 1))  # speed of one track over the other's
    levers = speed * np.concatenate([np.ones((count, 1)), inner], axis=1)
    turns_right = rng.random((count, 1)) < 0.5
    levers = np.where(turns_right, levers, levers[:, ::-1])
    levers[::4] = speed[::4]  # straight
    with_stops = np.zeros((2 * count, 2))
    with_stops[::2] = levers

    moving = np.full(2 * count, 0.5)
    driving = rng.uniform(3.5, 6.0, count)
    stopping = rng.uniform(0.5, 2.0, count)
    holding = np.stack([driving, stopping], axis=1).ravel()
    return _levers(time, driver, driver.max_speed * with_stops, moving, holding)


def _eights(time: Array, driver: Driver, rng: np.random.Generator) -> Array:
    """Speeds (T, 2) for figure eights at constant forward speed, with a heading that is sinusoidal
    in time.

    With the amplitude A, `_CLOSING`, and the frequency f, the heading is A sin(f t). A track's
    speed differs from the mean by up to u = A f b, with the half gauge b, and its acceleration is
    up to u f = u^2 / (A b). The start takes half of the acceleration.
    """
    ahead = rng.uniform(0.5, 0.7)  # share of the top speed; the rest is left for turning
    by_speed = (1 - ahead) * driver.max_speed
    by_acceleration = np.sqrt(_CLOSING / 2 * driver.acceleration * driver.half_gauge)
    turning = min(by_speed, by_acceleration)
    frequency = turning / (driver.half_gauge * _CLOSING)
    side = rng.choice([-1.0, 1.0])
    half = side * turning * np.sin(frequency * time)
    return _begun(time, driver, ahead * driver.max_speed, half)


def _loop(time: Array, driver: Driver, rng: np.random.Generator) -> Array:
    """Speeds (T, 2) for squares with rounded corners, in which the yaw rate is half a sine wave.

    A corner of a quarter turn lasts d. A track's speed differs from the mean by up to u; the yaw
    rate has the mean 2 / pi u / b, with the half gauge b, so d = pi^2 / 4 b / u. The acceleration
    is up to u pi / d = 4 u^2 / (pi b). The start takes half of the acceleration.
    """
    by_speed = 0.4 * driver.max_speed
    by_acceleration = np.sqrt(np.pi / 8 * driver.acceleration * driver.half_gauge)
    turning = min(by_speed, by_acceleration)
    corner = np.pi**2 / 4 * driver.half_gauge / turning  # [s]
    in_corner = np.clip(time % (_STRAIGHT + corner) - _STRAIGHT, 0.0, corner)  # [s]
    side = rng.choice([-1.0, 1.0])
    half = side * turning * np.sin(np.pi * in_corner / corner)
    return _begun(time, driver, 0.6 * driver.max_speed, half)


def _begun(time: Array, driver: Driver, ahead: float, half: Array) -> Array:
    """Speeds (T, 2), ahead -+ half [m/s]; the start uses half of the acceleration and leaves the
    rest to `half`.
    """
    ramp = 2 * _STEEPEST * driver.max_speed / driver.acceleration  # duration of the start [s]
    speed = ahead + TRACK_SIGNS * half[:, None]
    return speed * smooth_step(time / ramp)[:, None]


def _levers(time: Array, driver: Driver, levers: Array, moving: Array, holding: Array) -> Array:
    """Speeds (T, 2) that start from rest, and approach and hold each of `levers` (K, 2) in turn
    [m/s].

    An approach takes `moving` (K,), or longer if the acceleration requires it; each is held for
    `holding` (K,) [s].
    """
    rest = np.zeros((1, 2))
    change = np.abs(np.diff(levers, axis=0, prepend=rest)).max(axis=1)
    moving = np.maximum(moving, _STEEPEST * change / driver.acceleration)
    end = np.cumsum(moving + holding)
    begin = np.concatenate([[0.0], end[:-1]])

    # which lever position is approached or held at each time
    now = np.minimum(np.searchsorted(end, time, side="right"), len(levers) - 1)
    before = np.concatenate([rest, levers[:-1]])[now]
    share = smooth_step((time - begin[now]) / moving[now])
    return before + share[:, None] * (levers[now] - before)


DRIVING: Final[dict[str, Callable[[Array, Driver, np.random.Generator], Array]]] = {
    "random": _random,
    "eights": _eights,
    "stop_and_go": _stop_and_go,
    "loop": _loop,
}
"""Driving styles by name."""


@dataclass(frozen=True)
class Motion:
    """True poses of a robot over time."""

    time: Array  # (F,) ascending times [s]
    pose: Array  # (F, 3) poses with unwrapped headings [m, m, rad]

    def at(self, time: Array) -> Array:
        """Poses (..., 3) at times (...) within the motion, on arcs of constant twist between
        adjacent rows.
        """
        last = len(self.time) - 2
        before = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, last)
        after = before + 1
        share = (time - self.time[before]) / (self.time[after] - self.time[before])
        motion = se2.log(se2.between(self.pose[before], self.pose[after]))
        return se2.compose(self.pose[before], se2.exp(share[..., None] * motion))


def joined_log(encoders: RunLog, stamps: Array, poses: Array) -> RunLog:
    """Join encoder readings and poses (M, 3) with `stamps` (M,) [s] into a log with one row per
    time.

    `encoders` has a row per reading. A row with only a pose gets the sprocket speeds of the next
    reading, which are means over the interval around the pose. Poses stamped before the first or
    after the last reading are omitted. The truth in a row is that of the robot when the encoder
    clock shows the row's time.
    """
    read = encoders.time
    is_within = (stamps >= read[0]) & (stamps <= read[-1])
    stamps = stamps[is_within]
    poses = poses[is_within]
    time = np.union1d(read, stamps)
    after = np.searchsorted(read, time)
    before = np.searchsorted(read, time, side="right") - 1
    pose = np.full((len(time), 3), np.nan)
    valid = np.zeros(len(time), bool)
    has_pose = np.searchsorted(time, stamps)
    pose[has_pose] = poses
    valid[has_pose] = True
    return RunLog(
        run=encoders.run,
        time=time,
        omega=encoders.omega[after],
        pose=pose,
        command=None if encoders.command is None else encoders.command[before],
        valid=valid,
        read=np.isin(time, read),
        truth=None if encoders.truth is None else _truth_at(encoders.truth, read, time, after),
        metadata=encoders.metadata,
    )


def _truth_at(truth: Truth, read: Array, time: Array, after: np.ndarray) -> Truth:
    """Interpolate the truth from times `read` (T,) to `time` (U,); `after` (U,) are the next
    indices in `read`.
    """

    def interpolated(values: Array) -> Array:
        columns = values.reshape(len(read), -1).T
        between = [np.interp(time, read, column) for column in columns]
        return np.stack(between, axis=-1).reshape(-1, *values.shape[1:])

    fields = {}
    for name in ("twist", "traction", "torque", "lean", "contact"):
        values = getattr(truth, name)
        if values is not None:
            fields[name] = interpolated(values)
    for name in ("power", "saturated"):  # means since the previous reading
        values = getattr(truth, name)
        if values is not None:
            fields[name] = values[after]
    return Truth(pose=Motion(read, truth.pose).at(time), **fields)
