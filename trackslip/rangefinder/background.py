"""The background: what a scanner sees where nothing moves, found while the plate moves through it.

Whatever moves is in front of the background, and leaves it sooner or later. So each beam's background is the range at
which most returns are, provided that the beam seldom passes through it: a plate, a person or a parked robot is passed
through once it has gone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.scan import MIN_NOISE

_WINDOW = 0.1  # returns this close to the level belong to it, before the noise is known [m]
_MIN_SEEN = 5  # returns at the level, at least
_MIN_SHARE = 0.08  # of the scans that see the level, at least
_MIN_SOLID = 0.5  # share of the returns and misses from the level on that are at the level
_CERTAIN = 5.0  # returns this close to the level belong to it [standard deviations]
_MAX_SPREAD = 0.04  # standard deviation of ranges to a surface; evenly spread over the window, they have more [m]
_MIN_BEAMS = 10  # with background, from which to tell the noise


@dataclass(frozen=True)
class Background:
    """The background of each beam, and the noise of ranges to it."""

    level: Array  # (B,) [m]; NaN where there is none
    spread: Array  # (B,) standard deviation of a range to it [m]; NaN where there is none
    dropout: float
    """Share of the beams that should have met it but gave no return [-]."""

    @property
    def beams(self) -> int:
        """Number of beams with background."""
        return int(np.isfinite(self.level).sum())

    @property
    def noise(self) -> float | None:
        """Standard deviation of a range to the background [m]: the beams' median; None without enough of them."""
        known = np.isfinite(self.spread)
        return float(np.median(self.spread[known])) if known.sum() >= _MIN_BEAMS else None

    @property
    def levels(self) -> Array:
        """(3, B): ranges at which a return of each beam may be from the background.

        They are those of the beam and of its neighbours: at the edge of a thing, a beam that jitters meets it at times.
        """
        beside = np.full(1, np.nan)
        before, after = np.append(beside, self.level[:-1]), np.append(self.level[1:], beside)
        return np.stack([self.level, before, after])

    def tolerance(self, noise: float) -> Array:
        """(B,) how close to a level a return belongs to it [m], at most _WINDOW."""
        spread = np.fmax(np.nan_to_num(self.spread), max(noise, MIN_NOISE))
        beside = np.maximum(spread, np.maximum(np.append(spread[1:], 0.0), np.append(0.0, spread[:-1])))
        return np.minimum(_CERTAIN * beside, max(_WINDOW, _CERTAIN * noise))


def background_of(ranges: np.ndarray, hidden: np.ndarray | None = None) -> Background:
    """The background in scans (S, B), NaN for no return.

    Beams selected by `hidden` (S, B) are ignored, such as beams at and around a plate whose pose is known.
    """
    scans, beams = ranges.shape
    values = np.array(ranges.T, np.float32)  # (B, S)
    told = np.ones((beams, scans), bool) if hidden is None else ~hidden.T
    none = np.sum(told & np.isnan(values), axis=1)
    values[~told] = np.nan
    values.sort(axis=1)  # NaN last
    count = np.sum(np.isfinite(values), axis=1)
    upper, lower = _reach(values, _WINDOW), _reach(values, -_WINDOW)
    seen = upper - lower  # returns within the window around each return
    beyond = count[:, None] - upper + none[:, None]
    least = np.maximum(_MIN_SEEN, _MIN_SHARE * told.sum(axis=1))[:, None]
    solid = np.isfinite(values) & (seen >= least) & (seen >= _MIN_SOLID * (seen + beyond))
    best = np.argmax(np.where(solid, seen, -1), axis=1)
    found, row = solid.any(axis=1), np.arange(beams)
    at = (np.arange(scans) >= lower[row, best][:, None]) & (np.arange(scans) < upper[row, best][:, None])
    at &= found[:, None]
    part = np.where(at, values, np.nan).astype(float)[found]
    level, spread = np.full(beams, np.nan), np.full(beams, np.nan)
    if found.any():
        level[found] = np.nanmedian(part, axis=1)
        spread[found] = _spread(part - level[found, None])
        level[found] = _mean_near(part, level[found], spread[found])
        vague = spread > _MAX_SPREAD
        level[vague] = spread[vague] = np.nan
        found &= ~vague
    lost = none[found].sum() / max(int((none + seen[row, best])[found].sum()), 1)
    return Background(level, spread, float(lost))


def _reach(values: Array, window: float) -> np.ndarray:
    """(B, S): number of values of sorted rows (B, S), NaN last, below each value plus `window`."""
    rows = [np.searchsorted(row, row + np.float32(window), side="right" if window > 0 else "left") for row in values]
    return np.stack(rows)


def _spread(residual: Array) -> Array:
    """Standard deviations (n,) of residuals (n, S), NaN where there is none, without the outlying ones."""
    size = 1.4826 * np.nanmedian(np.abs(residual), axis=1)
    inner = np.abs(residual) <= np.maximum(4 * size, 4 * MIN_NOISE)[:, None]
    return np.sqrt(np.sum(np.where(inner, residual, 0.0) ** 2, axis=1) / np.maximum(inner.sum(axis=1) - 1, 1))


def _mean_near(values: Array, level: Array, spread: Array) -> Array:
    """Means (n,) of the values (n, S) within three standard deviations of the level (n,)."""
    near = np.abs(values - level[:, None]) <= 3 * np.maximum(spread, MIN_NOISE)[:, None]
    return np.sum(np.where(near, values, 0.0), axis=1) / np.maximum(near.sum(axis=1), 1)
