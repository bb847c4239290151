"""The laser range finder (LRF): its beams, rate and errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.errors import (
    Checked,
    checked,
    require,
    require_non_negative,
    require_positive,
    require_within,
)
from trackslip.kinematics import Array
from trackslip.localization.scan import Scan

_MAX_BEAMS = 20_000  # largest number of beams in a scan
_MIN_RATE = 5.0  # smallest scan rate [Hz]
_MAX_ERROR = 0.5  # largest error of a range from a single cause [m]
_MIN_STEP = 1e-6  # finest quantisation of ranges [m]


def require_share(name: str, value: float) -> None:
    """Raise InvalidValueError unless `value` is a share of something, not all of it."""
    require(0 <= value < 1, name, value, "at least 0 and less than 1")


@dataclass(frozen=True)
class LaserScanner(Checked):
    """A line scanner modelled on the SICK LMS 200; the paper doesn't name its scanner."""

    field_of_view: float = checked(float(np.pi), require_positive)
    """Angle between the first and the last beam [rad]."""
    resolution: float = checked(float(np.radians(0.25)), require_positive)
    """Angle between neighbouring beams [rad]."""
    rate: float = checked(20.0, require_positive)
    """Scans per second [Hz]."""
    noise: float = checked(0.005, require_non_negative, _MAX_ERROR, "m")
    """Standard deviation of a range [m]."""
    max_range: float = checked(20.0, require_positive, 1000.0, "m")
    """Surfaces farther away return no echo [m]."""
    dropout: float = checked(0.0, require_share)
    """Probability that a beam that hits a surface returns no echo [-]."""
    quantisation: float = checked(0.0, require_non_negative, _MAX_ERROR, "m")
    """Noisy ranges are rounded to multiples of this; 0 for no rounding [m]."""
    range_bias: float = checked(0.0, require_within, -_MAX_ERROR, _MAX_ERROR, "m")
    """Error common to all ranges [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        opened, step, rounding = self.field_of_view, self.resolution, self.quantisation
        few_beams = f"at least field_of_view / {_MAX_BEAMS}, for at most that many beams"
        for valid, name, allowed in (
            (not 0 < rounding < _MIN_STEP, "quantisation", f"0, or at least {_MIN_STEP:g} m"),
            (self.rate >= _MIN_RATE, "rate", f"at least {_MIN_RATE:g} Hz"),
            (opened / step <= _MAX_BEAMS, "resolution", few_beams),
            (step < opened <= 2 * np.pi, "field_of_view", "greater than the resolution, at most 2 pi"),
        ):
            require(valid, name, getattr(self, name), allowed)

    def measure(self, true_ranges: Array, rng: np.random.Generator) -> Array:
        """Measured ranges (..., B) for true ranges (..., B), NaN for no echo [m].

        This is the only place with noise, bias, rounding, dropout and reach.
        """
        ranges = rng.standard_normal(true_ranges.shape)
        ranges *= self.noise
        ranges += true_ranges
        ranges += self.range_bias
        if self.quantisation > 0:
            ranges = np.round(ranges / self.quantisation) * self.quantisation
        if self.dropout > 0:
            ranges[rng.random(ranges.shape) < self.dropout] = np.nan
        ranges[true_ranges > self.max_range] = np.nan
        return ranges

    def scan(self, ranges: Array, mount: Array) -> Scan:
        """Measured ranges (..., B) [m] as scans of this scanner at `mount` (3,) [m, m, rad]."""
        return Scan(self.bearings, ranges, self.range_std, mount, self.max_range, self.dropout)

    @property
    def period(self) -> float:
        """Time between scans [s]."""
        return 1 / self.rate

    @property
    def bearings(self) -> Array:
        """Directions (B,) of the beams in the LRF's frame [rad]."""
        beams = round(self.field_of_view / self.resolution) + 1
        return (np.arange(beams) - (beams - 1) / 2) * self.resolution

    @property
    def range_std(self) -> float:
        """Standard deviation of a range from noise and rounding [m]."""
        return float(np.hypot(self.noise, self.quantisation / np.sqrt(12)))
