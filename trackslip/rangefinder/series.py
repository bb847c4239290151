"""Scans of a laser range finder as its driver publishes them, and what is a return in them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackslip.errors import LogError, counted
from trackslip.kinematics import Array

_FULL_TURN = 1.5  # beams that a full circle may lack
_MIN_BEAMS = 8  # of a scan
MIN_SCANS = 20
"""Smallest number of scans that shows background and motion."""


@dataclass(frozen=True)
class ScanSeries:
    """All scans of a session by a scanner that stands still."""

    run: str
    """Name of the session."""
    time: Array  # (S,) of the scans' first ray [s], ascending
    bearings: Array  # (B,) of the beams in the scanner's frame, equally spaced, ascending [rad]
    ranges: np.ndarray  # (S, B) float32 [m]; NaN for no return
    lag: Array  # (B,) from the first ray to each beam [s]
    max_range: float
    """Nothing farther away gives a return [m]."""
    notes: tuple[str, ...] = ()
    """Parts that were left out, one line each."""

    @classmethod
    def measured(
        cls,
        run: str,
        time: Array,
        ranges: np.ndarray,
        angle_min: float,
        angle_increment: float,
        range_min: float = 0.0,
        range_max: float = np.inf,
        time_increment: float = 0.0,
    ) -> ScanSeries:
        """Scans (S, B) at the times (S,) of their first rays, with the fields of a `sensor_msgs/LaserScan`.

        Nothing came back where a range is not finite, below `range_min` or 0, or not below `range_max` (REP 117). Beams
        may run clockwise. Raises LogError for scans without beams, angles or returns.
        """
        beams = ranges.shape[1]
        if beams < _MIN_BEAMS or len(time) < MIN_SCANS:
            raise LogError(
                f"{counted(len(time), 'scan')} of {counted(beams, 'beam')}: needs at least {MIN_SCANS} of {_MIN_BEAMS}"
            )
        span = angle_increment * (beams - 1)
        if not (np.isfinite(angle_min) and 0 < abs(span) < 2 * np.pi + abs(angle_increment)):
            what = f"angle_min = {angle_min:g}, angle_increment = {angle_increment:g} for {beams} beams"
            raise LogError(f"{what}: must be at most a full circle [rad]")
        order = slice(None) if angle_increment > 0 else slice(None, None, -1)
        reach = range_max if range_max > 0 else np.inf
        kept = np.array(ranges[:, order], np.float32)
        with np.errstate(invalid="ignore"):
            kept[~((kept > 0) & (kept >= np.float32(range_min)) & (kept < np.float32(reach)))] = np.nan
        if not np.isfinite(kept).any():
            raise LogError("its scans have no return")
        bearings = (angle_min + angle_increment * np.arange(beams))[order]
        lag = (max(time_increment, 0.0) * np.arange(beams))[order]
        return cls(run, np.asarray(time, float), bearings, kept, lag, float(reach))

    @property
    def beam_step(self) -> float:
        """Angle between neighbouring beams [rad]."""
        return float((self.bearings[-1] - self.bearings[0]) / (len(self.bearings) - 1))

    @property
    def is_full_circle(self) -> bool:
        """True if the first beam follows the last."""
        return float(self.bearings[-1] - self.bearings[0]) > 2 * np.pi - _FULL_TURN * self.beam_step - 1e-6

    def take(self, rows: np.ndarray, note: str = "") -> ScanSeries:
        """The scans `rows`, with a note."""
        notes = (*self.notes, note) if note else self.notes
        return replace(self, time=self.time[rows], ranges=self.ranges[rows], notes=notes)

    def mirrored(self) -> ScanSeries:
        """The scans as seen from above, by a scanner that is mounted upside down."""
        return replace(self, bearings=-self.bearings[::-1], ranges=self.ranges[:, ::-1], lag=self.lag[::-1])

    def from_beam(self, first: int) -> ScanSeries:
        """A full circle that begins with the beam `first`, so that nothing of interest lies across its ends."""
        turned = np.append(self.bearings[first:], self.bearings[:first] + 2 * np.pi)
        bearings = turned[0] + self.beam_step * np.arange(len(turned))
        ranges = np.concatenate([self.ranges[:, first:], self.ranges[:, :first]], axis=1)
        return replace(self, bearings=bearings, ranges=ranges, lag=np.append(self.lag[first:], self.lag[:first]))
