"""Where strokes may lead: paths by all laws that the robot may have, with what slip adds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array
from trackslip.planning.limits import Knowledge
from trackslip.planning.strokes import Strokes

_PARTS = 8  # of each stroke
_DEVIATIONS = 3.5  # of slip that the area allows for


@dataclass(frozen=True)
class Places:
    """The rectangle that the middle of the robot stays in."""

    low: Array  # (2,) [m]
    high: Array  # (2,) [m]

    @property
    def size(self) -> Array:
        """Length and width (2,) [m]."""
        return np.asarray(self.high - self.low)


def places(strokes: Strokes, heading: float, knowledge: Knowledge) -> Places:
    """Where the middle of the robot may get to from the origin, with `heading` [rad] at the start."""
    x, y = path(strokes, heading, knowledge.extremes)
    spread = _DEVIATIONS * _slipped(strokes, x, y, knowledge)  # (2, L, K)
    both = np.stack([x, y])
    return Places((both - spread).min(axis=(1, 2)), (both + spread).max(axis=(1, 2)))


def path(strokes: Strokes, heading: float, laws: Array) -> tuple[Array, Array]:
    """Positions x, y (L, K) of the turning centre by laws (L, 3) of b + D [m] and 1 + epsilon of left and right."""
    way = np.repeat(strokes.way, _PARTS, axis=0) / _PARTS * laws[:, None, 1:]  # (L, M, 2)
    turn = (way[..., 1] - way[..., 0]) / (2 * laws[:, :1])
    after = heading + np.cumsum(turn, axis=1)
    chord = way.mean(axis=-1) * np.sinc(turn / (2 * np.pi))
    step = chord * np.exp(1j * (after - turn / 2))
    at = np.concatenate([np.zeros((len(laws), 1)), np.cumsum(step, axis=1)], axis=1)
    return at.real, at.imag


def _slipped(strokes: Strokes, x: Array, y: Array, knowledge: Knowledge) -> Array:
    """Standard deviations (2, L, K) of the positions by white slip."""
    along, across, turning = knowledge.slip
    part = np.repeat(np.abs(strokes.way).mean(axis=1), _PARTS) / _PARTS
    driven = np.concatenate([[0.0], np.cumsum(part)])

    def swung(lever: Array) -> Array:
        """Sum of the squares of levers from all parts before, times their ways."""
        middle = (lever[:, 1:] + lever[:, :-1]) / 2
        first = np.concatenate([np.zeros((len(lever), 1)), np.cumsum(middle * part, axis=1)], axis=1)
        second = np.concatenate([np.zeros((len(lever), 1)), np.cumsum(middle**2 * part, axis=1)], axis=1)
        return np.maximum(lever**2 * driven - 2 * lever * first + second, 0.0)

    moved = max(along, across) ** 2 * driven
    return np.sqrt(np.stack([moved + turning**2 * swung(y), moved + turning**2 * swung(x)]))
