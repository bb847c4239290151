"""Things that stand and walk in the field, cast by formulas of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.scan import Scan


def cylinders(scan: Scan, centre: Array, radius: float) -> Array:
    """Ranges (S, B) to upright cylinders about `centre` (S, 2) or (2,) in the world; inf where a beam misses."""
    world = np.column_stack([np.broadcast_to(centre, (len(scan.ranges), 2)), np.zeros(len(scan.ranges))])
    x, y = scan.from_world(world)[:, :2, None].swapaxes(0, 1)
    along = x * np.cos(scan.bearings) + y * np.sin(scan.bearings)
    inside = radius**2 - (x**2 + y**2 - along**2)
    near = along - np.sqrt(np.maximum(inside, 0.0))
    return np.where((inside > 0) & (near > 0), near, np.inf)


def wall(scan: Scan, start: Array, end: Array) -> Array:
    """Ranges (1, B) to the wall from `start` to `end` (2,) in the world; inf where a beam misses."""
    ends = scan.from_world(np.column_stack([np.stack([start, end]), np.zeros(2)]))[:, :2]
    side = ends[1] - ends[0]
    u = np.stack([np.cos(scan.bearings), np.sin(scan.bearings)])
    cross = u[0] * side[1] - u[1] * side[0]
    cross = np.where(cross == 0, 1e-12, cross)
    distance = (ends[0, 0] * side[1] - ends[0, 1] * side[0]) / cross
    fraction = (ends[0, 0] * u[1] - ends[0, 1] * u[0]) / cross
    return np.where((distance > 0) & (fraction >= 0) & (fraction <= 1), distance, np.inf)[None]


def among(scan: Scan, things: list[Array], rng: np.random.Generator) -> Scan:
    """The scan with `things`, ranges (S, B) or (1, B), in front of, behind and beside what it has seen."""
    nearest = np.minimum.reduce([np.broadcast_to(t, scan.ranges.shape) for t in things])
    seen = np.where(np.isfinite(scan.ranges), scan.ranges, np.inf)
    noisy = nearest + rng.normal(0.0, scan.noise, nearest.shape)
    ranges = np.where(nearest < seen, noisy, seen)
    return replace(scan, ranges=np.where(np.isfinite(ranges), ranges, np.nan))
