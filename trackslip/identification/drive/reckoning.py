"""Dead reckoning with derivatives: from the twists of the encoder intervals to the motion between any two times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array, arc_quotients


@dataclass(frozen=True)
class Path:
    """A path from the origin at given times, with derivatives by p parameters."""

    position: Array  # (K, 2) [m]
    heading: Array  # (K,) [rad]
    position_slope: Array  # (K, 2, p)
    heading_slope: Array  # (K, p)
    velocity: Array  # (K, 3) of the time: world velocity [m/s], yaw rate [rad/s]


def path_at(edges: Array, motion: Array, slope: Array, time: Array) -> Path:
    """The path at `time` (K,) of a robot that moves with (v, u, w), forwards, to the left and turning.

    `motion` (M, 3) is constant in each interval between `edges` (M + 1,), its derivatives are `slope` (M, 3, p).
    Beyond the ends, the first and the last motion continue.
    """
    step = np.diff(edges)
    turned, turned_slope = _started(motion[:, 2] * step), _started(slope[:, 2] * step[:, None])
    moved, moved_slope = _displaced(motion, slope, step, turned[:-1], turned_slope[:-1])
    reached, reached_slope = _started(moved), _started(moved_slope)
    row = np.clip(np.searchsorted(edges, time, side="right") - 1, 0, len(step) - 1)
    rest = time - edges[row]
    rest_moved, rest_slope = _displaced(motion[row], slope[row], rest, turned[row], turned_slope[row])
    heading = turned[row] + motion[row, 2] * rest
    cos, sin = np.cos(heading), np.sin(heading)
    v, u, w = motion[row].T
    return Path(
        reached[row] + rest_moved,
        heading,
        reached_slope[row] + rest_slope,
        turned_slope[row] + slope[row, 2] * rest[:, None],
        np.stack([cos * v - sin * u, sin * v + cos * u, w], axis=-1),
    )


def rotated(angle: Array, vector: Array) -> Array:
    """Vectors (..., 2) or (..., 2, p) turned by angles (...) [rad]."""
    extra = (None,) * (vector.ndim - angle.ndim - 1)
    cos, sin = np.cos(angle)[(..., *extra)], np.sin(angle)[(..., *extra)]
    axis = angle.ndim
    x, y = np.take(vector, 0, axis=axis), np.take(vector, 1, axis=axis)
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=axis)


def quarter(vector: Array, axis: int) -> Array:
    """Vectors turned by 90 degrees: the derivative of `rotated` by the angle, turned back."""
    x, y = np.take(vector, 0, axis=axis), np.take(vector, 1, axis=axis)
    return np.stack([-y, x], axis=axis)


def _displaced(motion: Array, slope: Array, step: Array, heading: Array, heading_slope: Array) -> tuple[Array, Array]:
    """World displacement (M, 2) by constant motions (M, 3) for `step` (M,) from headings (M,), and derivatives."""
    v, u, w = motion.T
    turn = w * step
    along, across, d_along, d_across = arc_quotients(turn)
    body = np.stack([v * along - u * across, v * across + u * along], axis=-1) * step[:, None]
    by_turn = np.stack([v * d_along - u * d_across, v * d_across + u * d_along], axis=-1) * step[:, None] ** 2
    dv, du, dw = slope[:, 0], slope[:, 1], slope[:, 2]
    body_slope = np.stack(
        [dv * along[:, None] - du * across[:, None], dv * across[:, None] + du * along[:, None]], axis=1
    )
    body_slope = body_slope * step[:, None, None] + by_turn[..., None] * dw[:, None, :]
    body_slope = body_slope + quarter(body, 1)[..., None] * heading_slope[:, None, :]
    return rotated(heading, body), rotated(heading, body_slope)


def _started(increments: Array) -> Array:
    """Sums (M + 1, ...) from zero of increments (M, ...)."""
    return np.concatenate([np.zeros((1, *increments.shape[1:])), np.cumsum(increments, axis=0)])
