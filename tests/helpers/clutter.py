"""Posts, walls and walkers in scans, and a robot on a circle tracked among them."""

from __future__ import annotations

from dataclasses import replace

import beside
import numpy as np
from beside import GEOMETRY, D

from trackslip.kinematics import Array, advance
from trackslip.localization.base import Locator, PoseEstimate
from trackslip.localization.pose_tracker import Tracker
from trackslip.localization.scan import Scan

PERIOD = 0.05
"""Time between scans [s]."""


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


def circle(twist: Array, start: Array, rows: int) -> Array:
    """Poses (rows, 3) of a robot that drives steadily, a row a scan."""
    return advance(start, twist, PERIOD * np.arange(rows))


def tracked(scan: Scan, poses: Array, twist: Array, locator: Locator, afterwards: bool) -> PoseEstimate:
    """Poses (S) of a robot that drives `poses` (S, 3) by a constant `twist` (2,), from scans (S, B) in turn.

    Each scan is located where the tracker expects the robot; `afterwards`, scans are first located by themselves, and
    again where expected only if the tracker refuses the pose.
    """
    tracks = twist[0] + np.array([-1, 1]) * (GEOMETRY.half_gauge + D) * twist[1]
    tracker, alone, parts = Tracker(poses[:1], GEOMETRY), locator.locate(scan), []
    for k in range(len(poses)):
        expected = tracker.predict(tracks[None] / GEOMETRY.sprocket_radius, PERIOD if k > 0 else 0.0)
        row = slice(k, k + 1)
        estimate = PoseEstimate(*(values[row] for values in vars(alone).values()))
        if not (afterwards and tracker.believes(estimate).all()):
            estimate = locator.locate(replace(scan, ranges=scan.ranges[row]), expected)
        parts.append(tracker.update(estimate))
    return PoseEstimate(*(np.concatenate(values) for values in zip(*(vars(p).values() for p in parts), strict=True)))
