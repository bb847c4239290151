"""Consistency of poses and encoders: odometry from the wheels, encoders that count backwards."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackslip import se2
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog

REPEATED_POSES = "its poses repeat the dead reckoning of the wheels: they tell nothing of slip"
REPEATED_WAYS = "its ways repeat those of the wheels: they tell nothing of ε"
_MIRRORED = "left and right are swapped, or the poses are mirrored"
DOUBTS = {
    "left": "the left encoder counts backwards",
    "right": "the right encoder counts backwards",
    "both": "both encoders count backwards (--reversed both), or the poses' heading points backwards",
    "swapped": _MIRRORED,
    "swapped, left": f"{_MIRRORED}, and the left encoder counts backwards",
    "swapped, right": f"{_MIRRORED}, and the right encoder counts backwards",
}
"""Possible faults of the encoders' sides, in words."""
_AS_STATED = ((1, 1), (-1, 1))
_FAULTY = {
    "left": ((-1, 1), (1, 1)),
    "right": ((1, -1), (-1, -1)),
    "both": ((-1, -1), (1, -1)),
    "backwards": ((-1, -1), (-1, 1)),
    "swapped": ((1, 1), (1, -1)),
    "swapped, left": ((-1, 1), (-1, -1)),
    "swapped, right": ((1, -1), (1, 1)),
}
"""What a robot's forward motion and its turn are proportional to: signs of the stated left and right turns in each."""
_STRIDE = 1.0  # time over which motions are compared [s]
_MIN_STRIDES = 10  # fewer motions prove nothing
_MIN_WAY, _MIN_TURN = 0.02, 0.05  # smaller motions prove nothing [m, rad]
_EXACT = 5e-3  # relative residual of poses computed from the wheels; noise-free poses on slipping ground have 6e-3
_CLEAR = 0.7  # share of the power of motion that signs of encoders must explain to be believed
_HALF_GAUGES = (0.05, 5.0)  # forward motion per turn and sprockets' turns: a tracked robot's with its slip [m]


class Strides(NamedTuple):
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
    time, pose = log.time[rows], log.pose[rows]
    ends = np.unique(np.searchsorted(time, np.arange(time[0], time[-1], _STRIDE)))
    if len(ends) <= _MIN_STRIDES:
        return None
    middle = pose[:-1, 2] + np.diff(pose[:, 2]) / 2
    steps = np.diff(turned.mean(axis=1))[:, None] * se2.direction(middle)
    reckoned = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    way, turn = np.split(np.diff(pose[ends], axis=0), [2], axis=1)
    turn = turn[:, 0]
    forward = se2.rotate(-pose[ends[:-1], 2] - turn / 2, way)[:, 0]
    if max(np.abs(forward).max() / _MIN_WAY, np.abs(turn).max() / _MIN_TURN) < 1.0:
        return None
    return Strides(way, np.diff(reckoned[ends], axis=0), forward, turn, np.diff(turned[ends], axis=0))


def repeated(found: Strides) -> str | None:
    """REPEATED_POSES, or REPEATED_WAYS with other headings; None if the poses are measured.

    Odometry from the wheels turns in proportion to the difference of the sprockets' turns and goes in proportion to
    their mean, whatever the factors. Measured poses don't: the ground slips, and measurements are noisy.
    """
    _, ways = _explained(found.by_wheels.reshape(-1, 1), found.way.ravel())
    _, turns = _explained(found.sprockets @ [[-1.0], [1.0]], found.turn)
    if ways < 1 - _EXACT**2:
        return None
    return REPEATED_POSES if turns >= 1 - _EXACT**2 else REPEATED_WAYS


def sign_doubt(found: Strides) -> str | None:
    """The likely fault of the encoders' sides, a key of DOUBTS; None if there is none or it doesn't show.

    A robot goes forward in proportion to the mean of its sprockets' turns and turns in proportion to their difference,
    with positive factors. There is a doubt only if that explains little of the motion with the signs stated, and most
    of it with other signs: on a path of constant radius, where both sides' turns are proportional, all signs may do.
    """
    if _share(found, *_AS_STATED) >= _CLEAR:
        return None
    shares = {fault: _share(found, *signs, limits=_HALF_GAUGES) for fault, signs in _FAULTY.items()}
    likely = max(shares, key=lambda fault: shares[fault])
    if shares[likely] < _CLEAR:
        return None
    return "both" if likely == "backwards" else likely


def _share(
    found: Strides, forward: tuple[int, int], turn: tuple[int, int], limits: tuple[float, float] = (0.0, np.inf)
) -> float:
    """The share of the power of motion that encoders with these signs explain, of forward motion or turns the less.

    0 if they need a negative factor, or an effective half gauge [m] beyond `limits`.
    """
    shares, factors = [], []
    for motion, signs, least in ((found.forward, forward, _MIN_WAY), (found.turn, turn, _MIN_TURN)):
        if np.abs(motion).max() >= least:
            (factor,), share = _explained(found.sprockets @ np.transpose([signs]), motion)
            shares.append(share if factor > 0 else 0.0)
            factors.append(factor)
    fits = len(factors) < 2 or limits[0] * factors[1] <= factors[0] <= limits[1] * factors[1]
    return min(shares) if fits else 0.0


def _explained(turns: Array, motion: Array) -> tuple[Array, float]:
    """Motion (n,) per turn (n, k) by least squares (k,), and the share of the motion's power that it explains."""
    slopes, *_ = np.linalg.lstsq(turns, motion, rcond=None)
    total = float(motion @ motion)
    left = motion - turns @ slopes
    return np.asarray(slopes), 1.0 - float(left @ left) / total if total else 0.0
