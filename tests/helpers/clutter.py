"""Posts, walls and walkers in scans."""

from __future__ import annotations

from dataclasses import replace

import beside
import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.scan import Scan


def cylinders(scan: Scan, centre: Array, radius: float) -> Array:
    """Ranges (S or 1, B) to upright cylinders about `centre` (S, 2) or (2,) in the world; inf where a beam misses."""
    return _ranges(scan, beside.cylinder(lambda _: centre[..., None, :], radius))


def wall(scan: Scan, start: Array, end: Array) -> Array:
    """Ranges (B,) to the wall from `start` to `end` (2,) in the world; inf where a beam misses."""
    return _ranges(scan, beside.wall(start, end))


def _ranges(scan: Scan, thing: beside.Thing) -> Array:
    x, y, heading = scan.mount
    angle = heading + scan.bearings
    return thing(np.array([x, y]), np.stack([np.cos(angle), np.sin(angle)], axis=-1), np.zeros(1))


def among(scan: Scan, things: list[Array], rng: np.random.Generator) -> Scan:
    """The scan with `things`, ranges (S, B) or (B,), merged into its nearest returns."""
    nearest = np.minimum.reduce([np.broadcast_to(t, scan.ranges.shape) for t in things])
    seen = np.where(np.isfinite(scan.ranges), scan.ranges, np.inf)
    noisy = nearest + rng.normal(0.0, scan.noise, nearest.shape)
    ranges = np.where(nearest < seen, noisy, seen)
    return replace(scan, ranges=np.where(np.isfinite(ranges), ranges, np.nan))
