"""Motion of the plate per turn of the sprockets: three rows by two tracks, fitted to the plate's poses.

The robot's geometry, its slip and the plate's place on it all enter linearly where the ICRs are constant, so none of
them has to be known to predict where the plate will be in the next scans, and which of its ends is the front one.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from trackslip import se2
from trackslip.kinematics import Array

_APART = 0.3  # time between the poses of a pair, at least [s]
_AT_MOST = 1.0  # the same, at most [s]
_JUMP = 0.6  # of a heading from one pose to the next, against the one expected, that ends a chain [rad]
_MIN_PAIRS = 20
_ROUNDS = 4  # of motion and the ends of the plate that lead
_ITERATIONS = 8
_UNLIKE = 0.3  # spread of the coefficients about those of like tracks, over their size [-]
_HUBER = 1.5  # residual above which the loss is linear [standard deviations]
_BLOCKS = 12  # of the session, each of which is left out once
_DETERMINED = {"x": 0.05, "y": 0.05, "yaw": 0.05}  # largest standard error of a value that is told [m, m, rad]
_MIN_UNLIKE = 0.05  # share of the driving with another ratio of the sprockets' speeds than the rest [-]
_MIN_TURN = 1e-6  # of the plate per radian of the sprockets [-]


@dataclass(frozen=True)
class Turned:
    """Angles by which the sprockets have turned since the first reading."""

    time: Array  # (E,) of the encoders' readings, ascending [s]
    angle: Array  # (E, 2) [rad]

    @classmethod
    def of(cls, time: Array, omega: Array) -> Turned:
        """From sprocket speeds (E, 2), means since the previous reading [rad/s]."""
        steps = omega[1:] * np.diff(time)[:, None]
        return cls(time, np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]))

    def at(self, time: Array) -> Array:
        """Angles (S, 2) at times (S,)."""
        return np.stack([np.interp(time, self.time, side) for side in self.angle.T], axis=-1)


@dataclass(frozen=True)
class PlateMotion:
    """Forward way, way to the left [m] and turn [rad] of the plate per radian of the left and right sprocket."""

    matrix: Array  # (3, 2)

    def path(self, angle: Array) -> Array:
        """Poses (S, 3) of the plate, from (0, 0, 0), where the sprockets have turned by angles (S, 2)."""
        return se2.chain(np.zeros(3), se2.exp(np.diff(angle, axis=0) @ self.matrix.T))


def plate_motion(time: Array, angle: Array, pose: Array, free: bool = False) -> PlateMotion | None:
    """The motion that fits poses (n, 3) at times (n,) best, known up to half a turn each; None for too few of them.

    Some poses may be wrong altogether. The front of the plate is the end that leads when both sprockets turn forwards.
    What the driving doesn't tell is taken from a plate in the middle of a robot with like tracks, unless it is `free`.
    """
    first, second = _pairs(time)
    if len(first) < _MIN_PAIRS:
        return None
    rolled = angle[second] - angle[first]
    turn = _half_turn(pose[second, 2] - pose[first, 2])
    by_turn = _slope(rolled[:, 1] - rolled[:, 0], turn)
    expected = by_turn * (rolled[:, 1] - rolled[:, 0])
    turn = expected + _half_turn(turn - expected)
    way = pose[second, :2] - pose[first, :2]
    forward, sideways = ways(way, pose[first, 2], turn)
    turned = by_turn * (angle[first, 1] - angle[first, 0])
    side, chain = _chains(time[first], pose[first, 2] - turned)
    sign = side * _fronts(chain, side * _leads(forward, sideways, rolled.sum(axis=1)))
    by_sum = _slope(rolled.sum(axis=1), sign * forward)
    usual = np.array([[by_sum, by_sum], [0.0, 0.0], [-by_turn, by_turn]])
    size = np.array([abs(by_sum), abs(by_sum), abs(by_turn)])
    spread = np.where(free, np.inf, np.maximum(_UNLIKE * size, 1e-6))
    by_turns = _robust(rolled, turn, usual[2], spread[2])
    for _ in range(_ROUNDS):
        targets = (sign * forward, sign * sideways)
        along, across = (_robust(rolled, way, usual[k], spread[k]) for k, way in enumerate(targets))
        sign = side * _fronts(chain, side * ((rolled @ along) * forward + (rolled @ across) * sideways))
    return PlateMotion(np.stack([along, across, by_turns]))


def ways(way: Array, heading: Array, turn: Array) -> tuple[Array, Array]:
    """Ways forward and to the left (n,) on arcs that turn by `turn` (n,) and lead along `way` (n, 2) in the world."""
    forward, left, _ = se2.log(np.column_stack([se2.rotate(-heading, way), turn])).T
    return forward, left


def _pairs(time: Array) -> tuple[np.ndarray, np.ndarray]:
    """Indices of poses and of those about _APART later."""
    second = np.searchsorted(time, time + _APART)
    first = np.flatnonzero(second < len(time))
    second = second[first]
    close = time[second] - time[first] < _AT_MOST
    return first[close], second[close]


def _chains(time: Array, offset: Array) -> tuple[Array, np.ndarray]:
    """(n,) 1 or -1 for headings of the same end, and (n,) the chain within which that holds.

    `offset` (n,) are headings, up to half a turn, less those expected; a chain ends where they jump or the time does.
    """
    whole = np.unwrap(offset, period=np.pi)
    side = np.where(np.round((whole - offset) / np.pi) % 2 == 0, 1.0, -1.0)
    breaks = (np.abs(np.diff(whole)) > _JUMP) | (np.diff(time) > _AT_MOST)
    return side, np.append(0, np.cumsum(breaks))


def _fronts(chain: np.ndarray, agreement: Array) -> Array:
    """(n,) 1, or -1 in chains whose agreement (n,) with the motion expected is negative in all."""
    return np.where(np.bincount(chain, agreement) < 0, -1.0, 1.0)[chain]


def _leads(forward: Array, sideways: Array, rolled: Array) -> Array:
    """Distances (n,) that the plate moves in the direction of the sprockets.

    The direction of motion, an axis in the plate, is the same for all pairs if the sprockets turn alike.
    """
    weight = rolled**2 * np.hypot(forward, sideways)
    axis = np.angle(np.sum(weight * np.exp(2j * np.arctan2(sideways, forward)))) / 2
    return np.asarray((np.cos(axis) * forward + np.sin(axis) * sideways) * rolled)


def _slope(x: Array, y: Array) -> float:
    """The slope that minimises the sum of absolute residuals of y = slope x: a weighted median of y / x."""
    moves = np.abs(x) > 1e-9
    if not moves.any():
        return 0.0
    ratio, weight = y[moves] / x[moves], np.abs(x[moves])
    order = np.argsort(ratio)
    half = np.searchsorted(np.cumsum(weight[order]), weight.sum() / 2)
    return float(ratio[order[half]])


def _robust(x: Array, y: Array, usual: Array, spread: float) -> Array:
    """Coefficients (2,) of y (n,) on x (n, 2) under a Huber loss, drawn to `usual` (2,) by a prior of some spread."""
    y = y - x @ usual
    weight = np.ones(len(y))
    found, scale = np.zeros(2), max(1.4826 * float(np.median(np.abs(y))), 1e-6)
    for _ in range(_ITERATIONS):
        root = np.sqrt(weight)[:, None]
        rows = np.concatenate([x * root, scale / spread * np.eye(2)])
        found = np.linalg.lstsq(rows, np.append(y * root[:, 0], np.zeros(2)), rcond=1e-9)[0]
        size = np.abs(y - x @ found)
        scale = max(1.4826 * float(np.median(size)), 1e-6)
        weight = np.minimum(1.0, _HUBER * scale / np.maximum(size, 1e-12)) ** 2
    return usual + found


def _half_turn(angle: Array) -> Array:
    """Angles modulo half a turn, in [-pi/2, pi/2)."""
    return np.asarray((angle + np.pi / 2) % np.pi - np.pi / 2)


@dataclass(frozen=True)
class PlatePlace:
    """Place and angle of the plate on the robot."""

    x: float
    """Its centre, ahead of the turning centre [m]."""
    y: float
    """Its centre, to the left of the middle of the tracks [m]."""
    yaw: float
    """Its heading on the robot, counter-clockwise [rad]."""
    stderr: dict[str, float]
    """Standard errors of those that the driving determines; the others are 0."""


def plate_place(time: Array, angle: Array, pose: Array) -> PlatePlace | None:
    """The place that follows from poses (n, 3) at times (n,), the sprockets turned by angles (n, 2) [rad].

    Standard errors are the jackknife's: the session cut into blocks, each left out once. None if nothing is determined.
    """
    spans = np.linalg.svd(np.diff(angle, axis=0), compute_uv=False)
    motion = plate_motion(time, angle, pose, free=True) if spans[1] > _MIN_UNLIKE * spans[0] else None
    found = None if motion is None else _place(motion)
    if found is None:
        return None
    edges = np.linspace(0, len(time), _BLOCKS + 1).astype(int)
    others = []
    for begin, end in pairwise(edges):
        rest = np.r_[0:begin, end : len(time)]
        without = plate_motion(time[rest], angle[rest], pose[rest], free=True)
        one = None if without is None else _place(without)
        if one is not None:
            others.append(one)
    if len(others) < _BLOCKS:
        return None
    scatter = np.array(others) - np.mean(others, axis=0)
    errors = np.sqrt((_BLOCKS - 1) / _BLOCKS * np.sum(scatter**2, axis=0))
    told = {name: float(error) for name, error in zip(_DETERMINED, errors, strict=True) if error < _DETERMINED[name]}
    x, y, yaw = (float(value) if name in told else 0.0 for name, value in zip(_DETERMINED, found, strict=True))
    return PlatePlace(x, y, yaw, told) if told else None


def _place(motion: PlateMotion) -> Array | None:
    """Place and angle (3,); None if the plate doesn't turn or goes ahead only backwards."""
    straight, spin = motion.matrix @ np.array([1.0, 1.0]), motion.matrix @ np.array([-1.0, 1.0])
    if abs(spin[2]) < _MIN_TURN or straight[0] <= 0:
        return None
    yaw = -np.arctan2(straight[1], straight[0])
    ahead, aside = se2.rotate(yaw, spin[:2] / spin[2])  # in the robot's frame
    return np.array([aside, -ahead, yaw])
