"""Poses that jump during steady motion: glitches, which come back, and lasting jumps, which don't.

While the sprockets turn steadily, every step of the robot in its own frame is the same but for noise. Dead reckoning by
the median step thus follows the poses whatever the slip: a pose that is off stands out of what remains however fast or
slowly poses come, and a lasting jump shows as a step between the means before and after.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from trackslip.kinematics import Array, wrap_angle

_BACK = 1.0  # time after which displaced poses are the continuation of the track, not a glitch [s]
_COMPARED = 0.5  # time before and after a jump over which poses are averaged, if that is enough poses [s]
_AVERAGED = 10  # poses that are enough
_MOST_AVERAGED = 100
_LEAST = np.array([0.05, np.radians(3.0)])  # smallest jump [m, rad]
_SHARE = 0.1  # smallest jump, relative to the way in the time of comparison: the robot's speed may vary a little
_MOST_TURNED = 3.0  # turn after which the chord of an arc is much shorter than the arc [rad]
_SIGNIFICANT = 6.0  # significant deviation [robust standard deviations]


@dataclass(frozen=True)
class Jumps:
    """The jumps among n poses."""

    glitch: np.ndarray  # (n,) bool: the pose is off
    lasting: tuple[int, ...]
    """The first row after each lasting jump, in order."""
    size: Array  # (n, 3) by how much a pose is off or, after a lasting jump, off the rows before [m, m, rad]


def find_jumps(time: Array, pose: Array) -> Jumps:
    """The jumps among poses (n, 3) at times (n,) of steady motion."""
    period = float(np.median(np.diff(time)))
    half = min(max(2, round(min(_BACK / period, _MOST_AVERAGED))), (len(time) - 1) // 2)
    size = np.zeros(pose.shape)
    path, heading, rate = _off_reckoning(time, pose, half)
    off = path - _running_median(path, half)
    off[:, 2] = wrap_angle(pose[:, 2] - heading)  # a heading that flips and returns may unwrap to another turn
    least = np.maximum(_LEAST, _SHARE * rate * half * period)
    significant = _SIGNIFICANT * (1 + 2 / half) * _spread(off)  # the median of few rows is often the row itself
    glitch = (_magnitude(off) > np.maximum(least, significant)).any(axis=1)
    size[glitch] = off[glitch]
    good = np.flatnonzero(~glitch)
    if len(good) <= 2 * half:
        return Jumps(glitch, (), size)
    if len(good) < len(time):
        path, _, rate = _off_reckoning(time[good], pose[good], half)
    lasting = _lasting(path, rate, period)
    for row, jump in lasting:
        size[good[row]] = jump
    return Jumps(glitch, tuple(sorted(int(good[row]) for row, _ in lasting)), size)


def _lasting(path: Array, rate: Array, period: float) -> list[tuple[int, Array]]:
    """First rows after lasting jumps of a path (n, 3) off dead reckoning, and their sizes (3,), the largest first.

    `rate` (2,) are speed and yaw rate.
    """
    count = len(path)
    width = max(_AVERAGED, round(min(_COMPARED / period, _MOST_AVERAGED)))
    width = max(1, min(width, count // 8))
    fewest = -(-width // 3)
    row = np.arange(fewest, count - fewest + 1)
    near = np.minimum(width, np.minimum(row, count - row))  # fewer at the ends
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(path, axis=0)])
    step = (total[row + near] - 2 * total[row] + total[row - near]) / near[:, None]
    step -= np.median(step, axis=0)
    scaled = step * np.sqrt(near / width)[:, None]
    least = np.maximum(_LEAST, _SHARE * rate * width * period)
    significant = np.maximum(_SIGNIFICANT * _spread(scaled), 1e-12)
    excess = np.minimum(_magnitude(step) / least, _magnitude(scaled) / significant).max(axis=1)
    found = []
    while excess[largest := int(np.argmax(excess))] > 1:
        found.append((int(row[largest]), step[largest]))
        excess[max(0, largest - width) : largest + width + 1] = 0.0
    return found


def _off_reckoning(time: Array, pose: Array, lag: int) -> tuple[Array, Array, Array]:
    """Poses (n, 3) less dead reckoning by the median motion, smooth headings (n,), and its speed and yaw rate (2,).

    Speed and yaw rate have no sign. The motion is measured over `lag` rows, or fewer if the robot turns far in them,
    which averages noise.
    """
    duration = np.diff(time)
    turn = wrap_angle(np.diff(pose[:, 2]))
    unwrapped = pose[0, 2] + np.concatenate([[0.0], np.cumsum(turn)])
    elapsed = time[lag:] - time[:-lag]
    yaw_rate = float(np.median((unwrapped[lag:] - unwrapped[:-lag]) / elapsed))
    steady = yaw_rate * (time - time[0])
    away = pose[:, 2] - steady
    cos, sin = _running_median(np.column_stack([np.cos(away), np.sin(away)]), lag).T
    heading = steady + np.arctan2(sin, cos)
    lag = max(1, min(lag, int(_MOST_TURNED / (abs(yaw_rate) * float(np.median(duration)) + 1e-12))))
    elapsed = time[lag:] - time[:-lag]
    place = pose[:, 0] + 1j * pose[:, 1]
    chord = (place[lag:] - place[:-lag]) * np.exp(-0.5j * (heading[lag:] + heading[:-lag]))
    rates = chord / elapsed / np.sinc(yaw_rate * elapsed / (2 * np.pi))
    rate = np.median(rates.real) + 1j * np.median(rates.imag)
    off = np.cumsum(np.diff(place) - rate * np.exp(0.5j * (heading[1:] + heading[:-1])) * duration)
    path = np.column_stack([off.real, off.imag, unwrapped[1:] - unwrapped[0] - yaw_rate * np.cumsum(duration)])
    return np.concatenate([np.zeros((1, 3)), path]), heading, np.abs([rate, yaw_rate])


def _spread(values: Array) -> Array:
    """Robust standard deviations (2,) about 0, of a coordinate and of the heading, from values (n, 3)."""
    spread: Array = np.median(_magnitude(values), axis=0) * [0.8493, 1.4826]  # a Rayleigh and a half-normal median
    return spread


def _magnitude(values: Array) -> Array:
    """Lengths of x and y, and magnitudes of the heading, (n, 2), of values (n, 3)."""
    return np.column_stack([np.hypot(values[:, 0], values[:, 1]), np.abs(values[:, 2])])


def _running_median(values: Array, half: int) -> Array:
    """Medians (n, K) of the `half` rows before and after each row of (n, K)."""
    return np.column_stack([scipy.ndimage.median_filter(column, 2 * half + 1, mode="mirror") for column in values.T])
