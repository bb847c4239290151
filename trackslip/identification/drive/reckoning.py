"""Dead reckoning with derivatives: from the twists of the encoder intervals to the motion between any two times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.se2 import Array, arc_quotients


@dataclass(frozen=True)
class Path:
    """A path from the origin at given times, with derivatives by p parameters; places are x + i y."""

    place: np.ndarray  # (K,) complex [m]
    heading: Array  # (K,) [rad]
    place_slope: np.ndarray  # (p, K) complex
    heading_slope: Array  # (p, K)
    velocity: np.ndarray  # (K,) complex, of the place by the time [m/s]
    yaw_rate: Array  # (K,) [rad/s]


def path_at(edges: Array, motion: Array, slope: Array, time: Array, row: np.ndarray) -> Path:
    """The path at `time` (K,) of a robot that moves with (v, u, w), forwards, to the left and turning.

    `motion` (3, M) is constant in each interval between `edges` (M + 1,), its derivatives are `slope` (3, p, M). `row`
    (K,) is the interval that each time lies in, or whose motion continues until then.
    """
    step = np.diff(edges)
    turned, turned_slope = _started(motion[2] * step), _started(slope[2] * step)
    moved, moved_slope = _displaced(motion, slope, step, turned[:-1], turned_slope[:, :-1])
    reached, reached_slope = _started(moved), _started(moved_slope)
    rest, here, here_slope = time - edges[row], motion[:, row], slope[..., row]
    heading, heading_slope = turned[row], turned_slope[:, row]
    moved, moved_slope = _displaced(here, here_slope, rest, heading, heading_slope)
    heading = heading + here[2] * rest
    return Path(
        reached[row] + moved,
        heading,
        reached_slope[:, row] + moved_slope,
        heading_slope + here_slope[2] * rest,
        np.exp(1j * heading) * (here[0] + 1j * here[1]),
        here[2],
    )


def _displaced(
    motion: Array, slope: Array, step: Array, heading: Array, heading_slope: Array
) -> tuple[np.ndarray, np.ndarray]:
    """World displacement (M,) by motions (3, M) for `step` (M,) from headings (M,), and derivatives (p, M)."""
    along, across, d_along, d_across = arc_quotients(motion[2] * step)
    turned, velocity = np.exp(1j * heading), motion[0] + 1j * motion[1]
    by_velocity = turned * (along + 1j * across) * step
    by_turn = turned * velocity * (d_along + 1j * d_across) * step**2
    moved = by_velocity * velocity
    moved_slope = by_velocity * slope[0] + (1j * by_velocity) * slope[1]
    moved_slope += by_turn * slope[2]
    moved_slope += (1j * moved) * heading_slope
    return moved, moved_slope


def _started(increments: np.ndarray) -> np.ndarray:
    """Sums (..., M + 1) from zero of increments (..., M)."""
    sums = np.zeros((*increments.shape[:-1], increments.shape[-1] + 1), increments.dtype)
    np.cumsum(increments, axis=-1, out=sums[..., 1:])
    return sums
