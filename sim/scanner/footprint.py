"""Mixed pixels: the range that a scanner measures when a beam's footprint covers several surfaces.

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

from trackslip.kinematics import Array

PULSE = 0.5
"""Echoes closer together than this merge [m]: pulses of 3.3 ns, assumed."""
MIN_SHARE = 0.25
"""Fraction of the footprint that an echo must fill to be detected [-], assumed."""
SUBRAYS = 9
"""Number of rays that represent a footprint."""
_MIN_RANGE = 1e-3  # keeps the light from a surface at the scanner finite [m]


def footprint(divergence: float) -> Array:
    """Angles (K,) between a beam's axis and the rays that represent it [rad]; a single ray without divergence."""
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
