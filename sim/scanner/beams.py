"""Beams of the scanner: their footprints, echoes and motion during a scan.

A beam of a SICK LMS 200 diverges by 4.4 mrad. Where its footprint straddles an edge, part of the light returns from the
surface in front and part from the one behind, and the measured range is that of neither (C. Ye and J. Borenstein,
Characterization of a 2-D Laser Scanner for Mobile Robot Obstacle Negotiation, ICRA 2002). The model describes pulses:

- the footprint is uniformly bright and all surfaces are equally reflective: a fraction of it returns light in
  proportion to the fraction and to 1 / range^2;
- echoes closer together than a pulse merge into one, whose range is their mean, weighted by that light;
- of separate echoes, the first that fills enough of the footprint is measured; weaker ones are missed.
"""

from __future__ import annotations

import numpy as np

from trackslip import se2
from trackslip.kinematics import Array

PULSE = 0.5
"""Separation below which echoes merge [m]: pulses of 3.3 ns, assumed."""
MIN_SHARE = 0.25
"""Fraction of the footprint that an echo must fill to be detected [-], assumed."""
SUBRAYS = 9
"""Number of rays that represent a footprint."""
_MIN_RANGE = 1e-3  # keeps the light from a surface at the scanner finite [m]


def moved_back(origin: Array, rays: Array, pose: Array, twist: Array, lag: Array) -> tuple[Array, Array]:
    """Origins and directions (N, B, K, 3) of rays, relative to robots whose twist is constant during the scan.

    The beams are moved instead of the plate: a ray transformed by the inverse of the plate's motion hits the plate at
    its pose at the scan's time, at the same range at which the true ray hits the plate at its pose at the beam's time.

    Args:
        origin: start (3,) of the true rays [m].
        rays: their directions (B, K, 3).
        pose: robots (N, 3) at the scan's time [m, m, rad].
        twist: forward and lateral speed [m/s] and yaw rate [rad/s] (N, 3).
        lag: times (B,) of the beams relative to the scan's [s].
    """
    back = se2.exp(-lag[:, None] * twist[:, None])  # (N, B, 3) to the robot's pose at the scan's time
    origins, directions = np.empty((2, len(pose), *rays.shape))
    start = se2.to_world(se2.compose(pose[:, None], back), se2.from_world(pose[:, None], origin[:2]))
    origins[..., :2], origins[..., 2] = start[:, :, None], origin[2]
    directions[..., :2], directions[..., 2] = se2.rotate(back[..., None, 2], rays[..., :2]), rays[..., 2]
    return origins, directions


def footprint(divergence: float) -> Array:
    """Angles (K,) of the rays that represent a beam, from its axis [rad]; one ray without divergence."""
    if divergence == 0:
        return np.zeros(1)
    return ((np.arange(SUBRAYS) + 0.5) / SUBRAYS - 0.5) * divergence


def echo(ranges: Array) -> Array:
    """Measured ranges (...) of beams whose rays have ranges (..., K), NaN for no echo [m]."""
    if ranges.shape[-1] == 1:
        return ranges[..., 0]
    first = np.fmin.reduce(ranges, axis=-1)
    together = ranges <= first[..., None] + PULSE
    light = np.where(together, 1 / np.maximum(ranges, _MIN_RANGE) ** 2, 0.0)
    with np.errstate(invalid="ignore"):
        mixed = np.asarray(np.sum(light * np.where(together, ranges, 0.0), axis=-1) / np.sum(light, axis=-1))
    weak = np.isfinite(first) & (together.mean(axis=-1) < MIN_SHARE)
    if weak.any():
        mixed[weak] = echo(np.where(together, np.nan, ranges)[weak])
    return mixed
