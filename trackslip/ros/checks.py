"""What poses and encoders tell of each other: wheel odometry, encoders that count backwards, clocks apart."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from trackslip.kinematics import Array, wrap_angle

_STRIDE = 1.0  # time over which motions are compared [s]
_MIN_STRIDES = 10  # number of motions that tell anything
_MIN_WAY = 0.02  # way of a motion that tells anything [m]
_MIN_TURN = 0.05  # turn of one [rad]
_EXACT = 1e-3  # relative residual of poses that are computed from the wheels
_CLEAR = 0.7  # share of the variance of motion that signs of encoders must explain to be believed
_AGAINST = 0.2  # speed per sprocket speed of a side that counts backwards, by that of the other side, at least


@dataclass(frozen=True)
class Strides:
    """Motions over a second each, by the poses and by the encoders."""

    forward: Array
    """(n,) along the heading in between [m]."""
    turn: Array
    """(n,) [rad]."""
    sprockets: Array
    """(n, 2) turns of the sprockets [rad]."""

    @property
    def enough(self) -> bool:
        """Whether they tell anything."""
        far = np.abs(self.forward).max(initial=0.0) > _MIN_WAY
        return len(self.forward) >= _MIN_STRIDES and bool(far or np.abs(self.turn).max(initial=0.0) > _MIN_TURN)


def strides(time: Array, omega: Array, at: Array, pose: Array) -> Strides:
    """Motions between poses (N, 3) at times (N,) about a second apart, which must be known with headings.

    `omega` (T, 2) are mean sprocket speeds since the previous time of `time` (T,).
    """
    turned = np.concatenate([np.zeros((1, 2)), np.cumsum(omega[1:] * np.diff(time)[:, None], axis=0)])
    known = np.flatnonzero(np.isfinite(pose).all(axis=1) & (at >= time[0]) & (at <= time[-1]))
    if len(known) < 2:
        return Strides(np.empty(0), np.empty(0), np.empty((0, 2)))
    at, pose = at[known], pose[known]
    heading = np.unwrap(pose[:, 2])
    marks = np.unique(np.searchsorted(at, np.arange(at[0], at[-1], _STRIDE)))
    way, turn = np.diff(pose[marks, :2], axis=0), np.diff(heading[marks])
    between = heading[marks[:-1]] + turn / 2
    forward = way[:, 0] * np.cos(between) + way[:, 1] * np.sin(between)
    angle = np.stack([np.interp(at[marks], time, side) for side in turned.T], axis=-1)
    return Strides(forward, np.asarray(turn), np.diff(angle, axis=0))


def repeats_wheels(time: Array, omega: Array, at: Array, pose: Array) -> bool:
    """Whether poses (N, 3) at times (N,) are the dead reckoning of sprocket speeds (T, 2) at times (T,), or repeat it.

    They are if turns between neighbouring poses are the difference of the sprockets' turns times a constant, and ways
    their sum times another, to a thousandth: nothing measured is as exact.
    """
    turned = np.concatenate([np.zeros((1, 2)), np.cumsum(omega[1:] * np.diff(time)[:, None], axis=0)])
    inside = np.flatnonzero(np.isfinite(pose).all(axis=1) & (at >= time[0]) & (at <= time[-1]))
    if len(inside) < _MIN_STRIDES:
        return False
    angle = np.stack([np.interp(at[inside], time, side) for side in turned.T], axis=-1)
    left, right = np.diff(angle, axis=0).T
    way = np.diff(pose[inside, :2], axis=0)
    turn = wrap_angle(np.diff(pose[inside, 2]))
    between = pose[inside[:-1], 2] + turn / 2
    forward = way[:, 0] * np.cos(between) + way[:, 1] * np.sin(between)
    told = [_residual(left + right, forward), _residual(right - left, turn)]
    return all(one is not None and one < _EXACT for one in told)


def _residual(by_wheels: Array, by_poses: Array) -> float | None:
    """What the poses have beside a multiple of what the wheels have, by root mean squares; None if neither moves."""
    power, total = float(by_wheels @ by_wheels), float(by_poses @ by_poses)
    if power == 0.0 or total == 0.0:
        return None
    gain = float(by_wheels @ by_poses) / power
    return float(np.sqrt(np.mean((by_poses - gain * by_wheels) ** 2) / (total / len(by_poses))))


class Doubt(Enum):
    """What may be wrong with the sides of encoders."""

    LEFT = "left"
    RIGHT = "right"
    BOTH = "both"
    SWAPPED = "swapped"


DOUBTS = {
    Doubt.LEFT: "the left encoder counts backwards",
    Doubt.RIGHT: "the right encoder counts backwards",
    Doubt.BOTH: "both encoders count backwards (--reversed both), or the poses' heading points backwards",
    Doubt.SWAPPED: "left and right are swapped, or the poses are mirrored",
}
"""In words."""


def sign_doubt(found: Strides) -> Doubt | None:
    """What seems to be wrong with the encoders' sides; None if nothing is, or if it can't be told."""
    if not found.enough:
        return None
    ways, fit = _slopes(found.sprockets, found.forward)
    turns, turn_fit = _slopes(found.sprockets, found.turn)
    if min(fit, turn_fit) < _CLEAR:
        return None
    least = _AGAINST * np.abs(ways).max()
    back, ahead = ways < -least, ways > least
    if back.any() and ahead.any():
        return Doubt.LEFT if back[0] else Doubt.RIGHT
    if back.all():
        return Doubt.BOTH
    return Doubt.SWAPPED if ahead.all() and turns[0] > 0 > turns[1] else None


def _slopes(sprockets: Array, motion: Array) -> tuple[Array, float]:
    """Motion per turn of each sprocket (2,), and the share of the motion's variance that it explains."""
    slopes, *_ = np.linalg.lstsq(sprockets, motion, rcond=None)
    total = float(motion @ motion)
    left = motion - sprockets @ slopes
    return np.asarray(slopes), 1.0 - float(left @ left) / total if total else 0.0
