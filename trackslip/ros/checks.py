"""What poses and encoders tell of each other: odometry from the wheels, encoders that count backwards."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from trackslip import se2
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog

_STRIDE = 1.0  # time over which motions are compared [s]
_MIN_STRIDES = 10  # number of motions that tell anything
_MIN_WAY, _MIN_TURN = 0.02, 0.05  # of the largest motion, so that they tell anything [m, rad]
_EXACT = 5e-3  # relative residual of poses computed from the wheels; noise-free poses on slipping ground have 6e-3
_CLEAR = 0.7  # share of the variance of motion that signs of encoders must explain to be believed
_AGAINST = 0.2  # speed per sprocket speed of a side that counts backwards, by that of the other side, at least


class Repeated(Enum):
    """What poses have from the wheels."""

    ALL = "its poses repeat the dead reckoning of the wheels: they tell nothing of slip"
    WAYS = "its ways repeat those of the wheels: they tell nothing of ε"


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


@dataclass(frozen=True)
class Strides:
    """Motions over a second each, by the poses and by the encoders."""

    way: Array
    """(n, 2) between the ends, along x and y [m]."""
    by_wheels: Array
    """(n, 2) the same by the mean of both sprockets' turns, in the poses' headings [rad]."""
    forward: Array
    """(n,) along the mean heading [m]."""
    turn: Array
    """(n,) [rad]."""
    sprockets: Array
    """(n, 2) turns of the sprockets [rad]."""


def strides(log: RunLog) -> Strides | None:
    """The motions in a log, from poses with heading; None if there are too few, or the robot hardly moves."""
    rows = np.flatnonzero(log.has_heading)
    if not len(rows):
        return None
    turned = np.concatenate([np.zeros((1, 2)), np.cumsum(log.omega[1:] * np.diff(log.time)[:, None], axis=0)])[rows]
    time, place, heading = log.time[rows], log.pose[rows, :2], log.pose[rows, 2]
    ends = np.unique(np.searchsorted(time, np.arange(time[0], time[-1], _STRIDE)))
    if len(ends) <= _MIN_STRIDES:
        return None
    middle = heading[:-1] + np.diff(heading) / 2
    steps = np.diff(turned.mean(axis=1))[:, None] * se2.direction(middle)
    reckoned = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    way, turn = np.diff(place[ends], axis=0), np.diff(heading[ends])
    forward = se2.rotate(-heading[ends[:-1]] - turn / 2, way)[:, 0]
    if max(np.abs(forward).max() / _MIN_WAY, np.abs(turn).max() / _MIN_TURN) < 1.0:
        return None
    return Strides(way, np.diff(reckoned[ends], axis=0), forward, turn, np.diff(turned[ends], axis=0))


def repeated(found: Strides) -> Repeated | None:
    """What the poses have from the wheels; None if they are measured.

    Odometry from the wheels turns in proportion to the difference of the sprockets' turns and goes in proportion to
    their mean, whatever the factors. Measured poses don't: the ground slips, and measurements are noisy.
    """
    ways = _residual(found.by_wheels.ravel(), found.way.ravel())
    turns = _residual(found.sprockets[:, 1] - found.sprockets[:, 0], found.turn)
    if ways > _EXACT:
        return None
    return Repeated.ALL if turns <= _EXACT else Repeated.WAYS


def sign_doubt(found: Strides) -> Doubt | None:
    """What seems to be wrong with the encoders' sides; None if nothing is, or if it can't be told."""
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


def _residual(by_wheels: Array, by_poses: Array) -> float:
    """What the poses have beside a multiple of what the wheels have, by root mean squares; infinite if either rests."""
    power, total = float(by_wheels @ by_wheels), float(by_poses @ by_poses)
    if power == 0.0 or total == 0.0:
        return np.inf
    left = by_poses - float(by_wheels @ by_poses) / power * by_wheels
    return float(np.sqrt(left @ left / total))


def _slopes(sprockets: Array, motion: Array) -> tuple[Array, float]:
    """Motion per turn of each sprocket (2,), and the share of the motion's variance that it explains."""
    slopes, *_ = np.linalg.lstsq(sprockets, motion, rcond=None)
    total = float(motion @ motion)
    left = motion - sprockets @ slopes
    return np.asarray(slopes), 1.0 - float(left @ left) / total if total else 0.0
