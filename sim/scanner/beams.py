"""Beams of the scanner: those that can hit a plate, their motion during a scan, and their footprints.

A beam of a SICK LMS 200 diverges by 4.4 mrad. Where its footprint straddles an edge, part of the light returns from the
surface in front and part from the one behind, and the measured range is that of neither (C. Ye and J. Borenstein,
Characterization of a 2-D Laser Scanner for Mobile Robot Obstacle Negotiation, ICRA 2002). The model describes pulses:

- the footprint is uniformly bright and all surfaces are equally reflective: a fraction of it returns light in
  proportion to the fraction and to 1 / range^2;
- echoes closer together than a pulse merge into one, whose range is their mean, weighted by that light;
- of separate echoes, the first that fills enough of the footprint is measured; weaker ones are missed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip import se2
from trackslip.kinematics import Array, wrap_angle

SLACK = 0.2
"""Margin around the plate, so that the beams need not be selected again for every scan [m]."""
PULSE = 0.5
"""Separation below which echoes merge [m]: pulses of 3.3 ns, assumed."""
MIN_SHARE = 0.25
"""Fraction of the footprint that an echo must fill to be detected [-], assumed."""
SUBRAYS = 9
"""Number of rays that represent a footprint."""
_MIN_RANGE = 1e-3  # keeps the light from a surface at the scanner finite [m]


@dataclass(frozen=True)
class Aim:
    """The beams that can hit plates near `centre`, whatever their headings; the same number for every robot."""

    centre: Array  # (N, 3) of the plates, when the beams were selected [m]
    beams: np.ndarray  # (N, W) among the B of all
    place: np.ndarray  # (N, W) the same among the N x B beams of all robots

    @classmethod
    def at(cls, centre: Array, origin: Array, heading: float, radius: float, bearings: Array, width: float) -> Aim:
        """Select the beams to cast at plates around `centre` (N, 3) [m].

        The beams start at `origin` (3,) [m] with equally spaced, ascending `bearings` (B,) from the world direction
        `heading` and are `width` wide [rad]. While they are cast, each plate stays within `radius` of its centre [m].
        """
        radius += SLACK
        x, y = (centre - origin)[:, :2].T
        distance = np.hypot(x, y)
        bearing = wrap_angle(np.arctan2(y, x) - heading)
        spread = np.where(distance > radius, np.arcsin(np.minimum(radius / np.maximum(distance, radius), 1.0)), np.pi)
        spread = spread + width / 2
        last = len(bearings) - 1
        step = (bearings[-1] - bearings[0]) / last
        low, high = ((edge - bearings[0]) / step for edge in (bearing - spread, bearing + spread))
        around = np.abs(bearing) + spread > np.pi  # behind the scanner, where the bearing wraps
        low, high = np.where(around, 0, np.clip(low, 0, last)), np.where(around, last, np.clip(high, 0, last))
        first = np.floor(low).astype(int)
        count = min(int((np.ceil(high) - first).max()), last) + 1
        beams = np.minimum(first, last + 1 - count)[:, None] + np.arange(count)
        return cls(centre, beams, np.arange(len(centre))[:, None] * len(bearings) + beams)

    def holds(self, centre: Array) -> bool:
        """True if the selection is still valid for plates around `centre` (N, 3)."""
        return bool(np.abs(centre - self.centre).max() <= SLACK / 2)


def moved_back(origin: Array, rays: Array, pose: Array, twist: Array, lag: Array) -> tuple[Array, Array]:
    """Origins and directions (N, W, K, 3) of rays, relative to robots whose twist is constant during the scan.

    Instead of the plate, the beams are moved: a ray transformed by the inverse of the plate's motion hits the plate at
    its pose at the scan's time, at the same range at which the true ray hits the plate at its pose at the beam's time.
    The true rays start at `origin` (3,) [m] and have the directions `rays` (N, W, K, 3); their times relative to the
    scan's are `lag` (N, W) [s]. The robots have `pose` (N, 3) at the scan's time [m, m, rad], and `twist` (N, 3):
    forward and lateral speed [m/s], yaw rate [rad/s].
    """
    back = se2.exp(-lag[..., None] * twist[:, None])  # (N, W, 3) to the robot's pose at the scan's time
    pose = pose[:, None]
    origins = np.broadcast_to(origin, (*rays.shape[:2], 1, 3)).copy()
    origins[..., 0, :2] = se2.to_world(se2.compose(pose, back), se2.from_world(pose, origin[:2]))
    directions = np.concatenate([se2.rotate(back[..., None, 2], rays[..., :2]), rays[..., 2:]], axis=-1)
    return np.broadcast_to(origins, rays.shape), directions


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
