"""Scans of the plate on a robot that moves as given: rays against a rectangle, in closed form."""

from __future__ import annotations

import numpy as np

from sim.scanner.scanner import LaserScanner
from sim.wander.motion import Motion
from trackslip.kinematics import Array
from trackslip.localization.scan import Plate, Scan

_AT_ONCE = 500  # scans


def plate_scans(
    scanner: LaserScanner, mount: Array, plate: Plate, motion: Motion, rng: np.random.Generator
) -> tuple[Array, Scan]:
    """Times (S,) [s] and scans (S, B) of the plate by a scanner at `mount` (3,), in an empty field.

    Of the scanner's errors, there are noise and reach. The first scan is at a random moment in the first period.
    """
    time = np.arange(motion.time[0] + rng.uniform(0, scanner.period), motion.time[-1], scanner.period)
    empty = Scan(scanner.bearings, np.empty((0, len(scanner.bearings))), scanner.noise, mount, scanner.max_range)
    pose = empty.from_world(motion.at(time))
    parts = [
        plate_ranges(plate, pose[k : k + _AT_ONCE], scanner.bearings).astype(np.float32)
        for k in range(0, len(pose), _AT_ONCE)
    ]
    ranges = np.concatenate(parts)
    ranges += scanner.noise * rng.standard_normal(ranges.shape, np.float32)
    ranges[ranges > scanner.max_range] = np.nan
    return time, Scan(scanner.bearings, ranges, scanner.noise, mount, scanner.max_range)


def plate_ranges(plate: Plate, pose: Array, bearings: Array) -> Array:
    """Ranges (S, B) [m] along `bearings` (B,) [rad] to plates at poses (S, 3) in the scanner's frame, NaN for a miss.

    A beam enters the strip between two opposite sides, and leaves it; it hits the plate where it has entered both
    strips before it leaves one of them.
    """
    x, y, heading = pose.T
    cos, sin = np.cos(heading), np.sin(heading)
    origin = -np.stack([cos * x + sin * y, cos * y - sin * x])[..., None]  # (2, S, 1), in the plate's frame
    angle = bearings - heading[:, None]
    direction = np.stack([np.cos(angle), np.sin(angle)])  # (2, S, B)
    half = np.array([plate.length, plate.thickness])[:, None, None] / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = np.stack([(-half - origin) / direction, (half - origin) / direction])
    enters, leaves = sides.min(axis=0).max(axis=0), sides.max(axis=0).min(axis=0)
    return np.where((enters <= leaves) & (enters > 0), enters, np.nan)
