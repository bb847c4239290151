"""Links between poses of single scans: the plate that moves as the encoders say, and its front."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip import se2
from trackslip.kinematics import Array
from trackslip.localization.pose_tracker import BLIND_TURN, GATE_HEADING, GATE_POSITION, GROWTH
from trackslip.localization.rows import Rows
from trackslip.rangefinder.plate_motion import PlateMotion, ways

_COMPARED = (1, 2, 3, 4, 8, 16)  # places of the poses before and after with which each is compared
_LONGEST = 2.0  # time between poses that are compared, and over which one is carried [s]
_ROUNDS = 2  # of votes; the poses that lost the first have none in the second
_TOLD = 0.05  # way that tells the front from the rear end, at least [m]
_CERTAIN_TURN = np.pi / 4  # error of the encoders' heading between pieces up to which it tells the front [rad]
_CLEAR = 0.3  # share of the way that must agree


@dataclass(frozen=True)
class Chain(Rows):
    """Poses of scans that were found, and what the encoders expect, in the same order."""

    time: Array  # (n,) [s]
    pose: Array  # (n, 3) known up to half a turn
    reckoned: Array  # (n, 3) where the encoders lead the plate, from any start

    def agrees(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """(m,) bool: whether the encoders lead from the poses `first` (m,) to `second` (m,), or nearly so."""
        expected = se2.between(self.reckoned[first], self.reckoned[second])
        turn = expected[:, 2]
        way = np.hypot(expected[:, 0], expected[:, 1])
        shift = self.pose[second, :2] - self.pose[first, :2]
        local = se2.rotate(-self.pose[first, 2], shift)
        off = np.minimum(*(np.hypot(*(local - sign * expected[:, :2]).T) for sign in (1, -1)))
        turned = self.pose[second, 2] - self.pose[first, 2] - turn
        wrong = np.abs((turned + np.pi / 2) % np.pi - np.pi / 2)
        near = off < GATE_POSITION + GROWTH * way
        return np.asarray(near & (wrong < GATE_HEADING + GROWTH * np.abs(turn)))


def consistent(chain: Chain) -> np.ndarray:
    """(n,) bool: poses that agree with more than half of those around them in time."""
    kept = np.arange(len(chain.time))
    for _ in range(_ROUNDS):
        kept = kept[_outvoting(chain.take(kept))]
    chosen = np.zeros(len(chain.time), bool)
    chosen[kept] = True
    return chosen


def _outvoting(chain: Chain) -> np.ndarray:
    count = len(chain.time)
    votes, voters = np.zeros(count), np.zeros(count)
    for apart in _COMPARED:
        first = np.arange(max(count - apart, 0))
        second = first + apart
        close = chain.time[second] - chain.time[first] < _LONGEST
        first, second = first[close], second[close]
        agreed = chain.agrees(first, second)
        for side in (first, second):
            votes[side] += agreed
            voters[side] += 1
    return np.asarray(2 * votes > voters)


def headings(chain: Chain, motion: PlateMotion, angle: Array) -> tuple[Array, np.ndarray]:
    """Headings (n,) with the front ahead, unwrapped, and (n,) bool where it is known which end that is.

    Within a piece, half turns follow from the encoders; which end leads follows from the way of each piece.
    """
    count = len(chain.time)
    turned = chain.reckoned[:, 2]
    here = np.arange(count - 1)
    blind = GROWTH * np.abs(np.diff(turned)) > BLIND_TURN
    starts = np.append(True, ~chain.agrees(here, here + 1) | blind)
    piece = np.cumsum(starts) - 1
    offset = chain.pose[:, 2] - turned
    first = np.flatnonzero(starts)
    for begin, end in zip(first, np.append(first[1:], count), strict=True):
        offset[begin:end] = np.unwrap(offset[begin:end], period=np.pi)
    score, size = _leading(chain, motion, angle, offset + turned, piece)
    ends = np.stack([offset[first], offset[np.append(first[1:], count) - 1]], axis=-1)
    half_turns, known = _fronts(ends, score, size)
    return offset + np.pi * half_turns[piece] + turned, known[piece]


def _fronts(ends: Array, score: Array, size: Array) -> tuple[np.ndarray, np.ndarray]:
    """Half turns (p,) to add to each piece so that its front leads, and (p,) bool where they are known.

    The encoders tell how far the robot turns between pieces, and so which half turn is right, unless they are far off;
    then the piece's own way tells. `ends` (p, 2) are headings less those of the encoders, at both ends of the pieces.
    """
    longest = int(np.argmax(size))
    told = (size > _TOLD**2) & (np.abs(score) > _CLEAR * size)
    flips, known = np.zeros(len(size), int), told.copy()
    if not told[longest]:
        return flips, np.zeros(len(size), bool)
    flips[longest] = int(score[longest] < 0)
    for way, side in ((1, 1), (-1, 0)):
        k = longest + way
        while 0 <= k < len(size):
            jump = ends[k, 1 - side] - ends[k - way, side] - np.pi * flips[k - way]
            nearest = round(-jump / np.pi)
            if abs(jump + np.pi * nearest) < _CERTAIN_TURN:
                flips[k], known[k] = nearest, True
            else:
                front = int(score[k] < 0)
                flips[k] = front + 2 * round((-jump / np.pi - front) / 2)
            k += way
    return flips, known


def carried(chain: Chain, time: Array, reckoned: Array) -> tuple[Array, np.ndarray]:
    """Poses (S, 3) expected at times (S,), carried by the encoders from the nearest pose, and (S,) bool if it is near.

    `reckoned` (S, 3) is where the encoders lead the plate at those times, from the same start as in the chain.
    """
    after = np.clip(np.searchsorted(chain.time, time), 1, len(chain.time) - 1)
    earlier = time - chain.time[after - 1] < chain.time[after] - time
    nearest = np.where(earlier, after - 1, after)
    step = se2.between(chain.reckoned[nearest], reckoned)
    return se2.compose(chain.pose[nearest], step), np.abs(chain.time[nearest] - time) < _LONGEST


def _leading(chain: Chain, motion: PlateMotion, angle: Array, heading: Array, piece: np.ndarray) -> tuple[Array, Array]:
    """Sums over each piece of way measured times way expected, and of the latter's square [m^2]."""
    first = np.arange(len(chain.time) - 1)
    second = np.minimum(np.searchsorted(chain.time, chain.time[first] + 0.3), len(chain.time) - 1)
    same = piece[first] == piece[second]
    first, second = first[same], second[same]
    turn = heading[second] - heading[first]
    forward, left = ways(chain.pose[second, :2] - chain.pose[first, :2], heading[first], turn)
    expected = (angle[second] - angle[first]) @ motion.matrix.T
    product = forward * expected[:, 0] + left * expected[:, 1]
    square = np.sum(expected[:, :2] ** 2, axis=1)
    pieces = int(piece[-1]) + 1
    return tuple(np.bincount(piece[first], values, pieces) for values in (product, square))  # type: ignore[return-value]
