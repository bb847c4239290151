"""Simulated drives: track speeds from a driver with one lever per track, true poses over time, and
logs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sim.terrain.pieces import smooth_step
from trackslip import se2
from trackslip.errors import Checked, InvalidValueError, checked, require, require_positive
from trackslip.kinematics import TRACK_SIGNS, Array
from trackslip.logs.runlog import RunLog, Truth

_STEEPEST = 1.5  # largest slope of the smooth step 3 u^2 - 2 u^3 from 0 to 1, at u = 1/2
# first zero of J_0: amplitude of a sinusoidal heading that closes a figure eight [rad]
_CLOSING = 2.404825557695773
_BACK = -0.3  # lowest position of a lever unless both reverse [share of its forward travel]
_STRAIGHT = 4.0  # duration of each straight side of a loop [s]


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
    time = np.arange(int(duration * rate + 1e-9) + 1) / rate
    require(
        len(time) >= 2, "duration", duration, f"at least a period of the encoders, {1 / rate:g} s"
    )
    return DRIVING[driving](time, driver, rng)


def _random(time: Array, driver: Driver, rng: np.random.Generator) -> Array:
    """Speeds (T, 2): levers move smoothly between random positions; sometimes both are equal,
    reverse or rest.
    """
    count = int(time[-1]) + 2  # enough positions, as each takes more than a second
    levers = _BACK + (1 - _BACK) * rng.random((count, 2)) ** 0.6  # mostly forwards
    kinds = rng.choice(4, count, p=(0.8, 0.08, 0.06, 0.06))[:, None]
    levers = np.choose(
        kinds, [levers, np.broadcast_to(np.abs(levers[:, :1]), levers.shape), -levers, 0 * levers]
    )
    return _levers(
        time,
        driver,
        driver.max_speed * levers,
        rng.uniform(0.8, 1.4, count),
        rng.uniform(0.5, 1.5, count),
    )


def _stop_and_go(time: Array, driver: Driver, rng: np.random.Generator) -> Array:
    """Speeds (T, 2) for straights and turns at constant speeds, with stops in between."""
    count = int(time[-1] / 4.0) + 2  # enough stretches, as each takes at least 4 s with its stop
    speed = rng.uniform(0.4, 1.0, (count, 1))
    levers = speed * np.concatenate(
        [np.ones((count, 1)), rng.uniform(0.0, 1.0, (count, 1))], axis=1
    )
    levers = np.where(rng.random((count, 1)) < 0.5, levers, levers[:, ::-1])
    levers[::4] = speed[::4]  # straight
    both = np.zeros((2 * count, 2))
    both[::2] = levers
    holding = np.stack([rng.uniform(3.5, 6.0, count), rng.uniform(0.5, 2.0, count)], axis=1).ravel()
    return _levers(time, driver, driver.max_speed * both, np.full(2 * count, 0.5), holding)


def _eights(time: Array, driver: Driver, rng: np.random.Generator) -> Array:
    """Speeds (T, 2) for figure eights at constant forward speed, with a heading that is sinusoidal
    in time.
    """
    ahead = rng.uniform(0.5, 0.7)  # share of the top speed; the rest is left for turning
    turning = min(
        (1 - ahead) * driver.max_speed,
        np.sqrt(_CLOSING / 2 * driver.acceleration * driver.half_gauge),
    )
    frequency = turning / (driver.half_gauge * _CLOSING)
    half = rng.choice([-1.0, 1.0]) * turning * np.sin(frequency * time)
    return _begun(time, driver, ahead * driver.max_speed, half)


def _loop(time: Array, driver: Driver, rng: np.random.Generator) -> Array:
    turning = min(
        0.4 * driver.max_speed, np.sqrt(np.pi / 8 * driver.acceleration * driver.half_gauge)
    )
    # duration, in which the yaw rate is half a sine wave [s]
    corner = np.pi**2 / 4 * driver.half_gauge / turning
    into = np.clip(time % (_STRAIGHT + corner) - _STRAIGHT, 0.0, corner)
    half = rng.choice([-1.0, 1.0]) * turning * np.sin(np.pi * into / corner)
    return _begun(time, driver, 0.6 * driver.max_speed, half)


def _begun(time: Array, driver: Driver, ahead: float, half: Array) -> Array:
    """Speeds (T, 2), ahead -+ half [m/s]; the start uses half of the acceleration and leaves the
    rest to `half`.
    """
    ramp = 2 * _STEEPEST * driver.max_speed / driver.acceleration
    return (ahead + TRACK_SIGNS * half[:, None]) * smooth_step(time / ramp)[:, None]


def _levers(time: Array, driver: Driver, levers: Array, moving: Array, holding: Array) -> Array:
    """Speeds (T, 2) that start from rest, and approach and hold each of `levers` (K, 2) in turn
    [m/s].

    An approach takes `moving` (K,), or longer if the acceleration requires it; each is held for
    `holding` (K,) [s].
    """
    change = np.abs(np.diff(levers, axis=0, prepend=np.zeros((1, 2)))).max(axis=1)
    moving = np.maximum(moving, _STEEPEST * change / driver.acceleration)
    ends = np.cumsum(moving + holding)
    begins = np.concatenate([[0.0], ends[:-1]])
    now = np.minimum(np.searchsorted(ends, time, side="right"), len(levers) - 1)
    before = np.concatenate([np.zeros((1, 2)), levers[:-1]])[now]
    return before + smooth_step((time - begins[now]) / moving[now])[:, None] * (
        levers[now] - before
    )


DRIVING: dict[str, Callable[[Array, Driver, np.random.Generator], Array]] = {
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
        k = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2)
        share = (time - self.time[k]) / (self.time[k + 1] - self.time[k])
        motion = se2.log(se2.between(self.pose[k], self.pose[k + 1]))
        return se2.compose(self.pose[k], se2.exp(share[..., None] * motion))


def joined_log(encoders: RunLog, stamps: Array, poses: Array) -> RunLog:
    """Join encoder readings and poses (M, 3) with `stamps` (M,) [s] into a log with one row per
    time.

    `encoders` has a row per reading. A row with only a pose gets the sprocket speeds of the next
    reading, which are means over the interval around the pose. Poses stamped before the first or
    after the last reading are omitted. The truth in a row is that of the robot when the encoder
    clock shows the row's time.
    """
    read = encoders.time
    within = (stamps >= read[0]) & (stamps <= read[-1])
    stamps, poses = stamps[within], poses[within]
    time = np.union1d(read, stamps)
    after = np.searchsorted(read, time)
    held = np.searchsorted(read, time, side="right") - 1
    pose = np.full((len(time), 3), np.nan)
    valid = np.zeros(len(time), bool)
    seen = np.searchsorted(time, stamps)
    pose[seen], valid[seen] = poses, True
    return RunLog(
        run=encoders.run,
        time=time,
        omega=encoders.omega[after],
        pose=pose,
        command=None if encoders.command is None else encoders.command[held],
        valid=valid,
        read=np.isin(time, read),
        truth=None if encoders.truth is None else _truth_at(encoders.truth, read, time, after),
        metadata=encoders.metadata,
    )


def _truth_at(truth: Truth, read: Array, time: Array, after: np.ndarray) -> Truth:
    """Interpolate the truth from times `read` (T,) to `time` (U,); `after` (U,) are the next
    indices in `read`.
    """

    def between(values: Array) -> Array:
        flat = values.reshape(len(read), -1)
        return np.stack([np.interp(time, read, column) for column in flat.T], -1).reshape(
            -1, *values.shape[1:]
        )

    smooth = {
        name: getattr(truth, name) for name in ("twist", "traction", "torque", "lean", "contact")
    }
    means = {name: getattr(truth, name) for name in ("power", "saturated")}
    return Truth(
        pose=Motion(read, truth.pose).at(time),
        **{name: between(values) for name, values in smooth.items() if values is not None},
        **{name: values[after] for name, values in means.items() if values is not None},
    )
