"""Poses that repeat the dead reckoning of the wheels, and encoders that count backwards."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackslip import se2
from trackslip.bags.choice import SIDES
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog

REPEATED = "its poses repeat the dead reckoning of the wheels: they tell nothing of slip"
_STRIDE = 1.0  # time over which motions are compared [s]
_MIN_STRIDES = 10  # fewer motions prove nothing
_MIN_WAY, _MIN_TURN = 0.02, 0.05  # smaller motions prove nothing [m, rad]
_EXACT = 5e-3  # relative residual of poses computed from the wheels; noise-free poses on slipping ground have 6e-3
_CLEAR = 0.7  # share of the power of motion that signs of encoders must explain to be believed
_HALF_GAUGES = (0.05, 5.0)  # forward motion per turn and sprockets' turns: a tracked robot's with its slip [m]


class Strides(NamedTuple):
    """Motions over a second each, by the poses and by the encoders."""

    way: Array  # (n, 2) between the ends, along x and y [m]
    by_wheels: Array  # (n, 2) the same by the mean of both sprockets' turns, in the poses' headings [rad]
    forward: Array  # (n,) along the mean heading [m]
    turn: Array  # (n,) [rad]
    sprockets: Array  # (n, 2) turns of the sprockets [rad]


def strides(log: RunLog) -> Strides | None:
    """The motions in a log, from poses with heading; None if there are too few, or the robot hardly moves."""
    rows = np.flatnonzero(log.has_place & log.has_heading)
    if not len(rows):
        return None
    turned = np.concatenate([np.zeros((1, 2)), np.cumsum(log.omega[1:] * np.diff(log.time)[:, None], axis=0)])[rows]
    time, pose = log.time[rows], log.pose[rows]
    ends = np.unique(np.searchsorted(time, np.arange(time[0], time[-1], _STRIDE)))
    if len(ends) <= _MIN_STRIDES:
        return None
    middle = pose[:-1, 2] + np.diff(pose[:, 2]) / 2
    steps = np.diff(turned.mean(axis=1))[:, None] * se2.direction(middle)
    reckoned = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    way, turn = np.split(np.diff(pose[ends], axis=0), [2], axis=1)
    forward = se2.rotate(-pose[ends[:-1], 2] - turn[:, 0] / 2, way)[:, 0]
    if max(np.abs(forward).max() / _MIN_WAY, np.abs(turn).max() / _MIN_TURN) < 1.0:
        return None
    return Strides(way, np.diff(reckoned[ends], axis=0), forward, turn[:, 0], np.diff(turned[ends], axis=0))


def repeat_wheels(motions: Strides) -> bool:
    """True if ways and turns are in proportion to the sprockets', which measured ones aren't: the ground slips."""
    _, ways = _explained(motions.by_wheels.ravel(), motions.way.ravel())
    _, turns = _explained(motions.sprockets @ [-1.0, 1.0], motions.turn)
    return min(ways, turns) >= 1 - _EXACT**2


def backward_encoder(motions: Strides) -> str | None:
    """The side whose encoder counts backwards; None if neither does, or it doesn't show.

    A robot goes forward in proportion to the mean of its sprockets' turns and turns in proportion to their difference,
    with positive factors. An encoder counts backwards only if that explains little of the motion as it is, and most of
    it with the other sign: on a path of constant radius, where both sides' turns are proportional, both signs may do.
    """
    if _share(motions, np.ones(2), (0.0, np.inf)) >= _CLEAR:
        return None
    shares = [_share(motions, np.array(signs), _HALF_GAUGES) for signs in ((-1, 1), (1, -1))]
    return SIDES[int(np.argmax(shares))] if max(shares) >= _CLEAR else None


def _share(motions: Strides, signs: Array, half_gauges: tuple[float, float]) -> float:
    """The share of the power of motion that encoders with these signs explain, of forward motion or turns the less.

    0 if they need a negative factor, or an effective half gauge [m] beyond the limits.
    """
    sprockets = motions.sprockets * signs
    shares, factors = [], []
    for motion, turns, least in (
        (motions.forward, sprockets.sum(axis=1), _MIN_WAY),
        (motions.turn, sprockets @ [-1.0, 1.0], _MIN_TURN),
    ):
        if np.abs(motion).max() >= least:
            factor, share = _explained(turns, motion)
            shares.append(share if factor > 0 else 0.0)
            factors.append(factor)
    low, high = half_gauges
    fits = len(factors) < 2 or low * factors[1] <= factors[0] <= high * factors[1]
    return min(shares) if fits else 0.0


def _explained(turns: Array, motion: Array) -> tuple[float, float]:
    """Motion (n,) per turn (n,) by least squares, and the share of the motion's power that it explains."""
    slope = float(turns @ motion) / max(float(turns @ turns), 1e-300)
    total, left = float(motion @ motion), motion - turns * slope
    return slope, 1.0 - float(left @ left) / total if total else 0.0
