"""The footprint of a beam, and what a scanner makes of one that meets more than one thing: mixed pixels.

A beam of a SICK LMS 200 widens by 4.4 mrad. Where its footprint straddles an edge, part of the light comes back from
the thing in front and part from the one behind, and the range is neither's (C. Ye and J. Borenstein, Characterization
of a 2-D Laser Scanner for Mobile Robot Obstacle Negotiation, ICRA 2002). The model here is one of pulses:

- the footprint is as bright everywhere, and every surface scatters back alike: a share of it returns light in
  proportion to the share and to 1 / range^2;
- echoes less than a pulse apart run into one, whose range is their mean, weighted with that light;
- of echoes farther apart the first that fills enough of the footprint is taken, weaker ones go unnoticed.
"""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array

PULSE = 0.5
"""Ranges nearer to each other than this run into one echo [m]: pulses of 3.3 ns, assumed."""
MIN_SHARE = 0.25
"""Of a footprint, which an echo must fill to be noticed [-], assumed."""
SUBRAYS = 9
"""Rays that stand for a footprint."""
_MIN_RANGE = 1e-3  # so that the light from something at the scanner itself is finite [m]


def footprint(divergence: float) -> Array:
    """Angles (K,) [rad] between a beam's middle and the rays that stand for it; without divergence, one ray."""
    if divergence == 0:
        return np.zeros(1)
    return ((np.arange(SUBRAYS) + 0.5) / SUBRAYS - 0.5) * divergence


def echo(ranges: Array) -> Array:
    """Ranges (...) of the echoes taken, of beams whose rays have ranges (..., K), NaN where nothing comes back [m]."""
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
