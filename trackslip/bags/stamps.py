"""Checks on message stamps: order, zeros, bursts, and clocks that restart or differ."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.logs.checks import gaps, in_order, restarts

_SIMULATED: Final = 10**17  # stamps before this time, in 1973, are from a simulation [ns]
# difference between delays above which clocks differ: matching a scan takes less time [s]
_APART: Final = 1.0
# ratio to the usual interval below which readings are in a burst, with more than tenfold speeds
_BURST: Final = 0.1
# least usual interval: half that of the fastest controllers, which run at 1 kHz [ns]
_SHORTEST: Final = 500_000


@dataclass(frozen=True)
class Readings:
    """Numbers read from stamped messages."""

    source: str  # the topic, or tf:PARENT:CHILD
    stamp: np.ndarray  # (N,) int: stamps in the headers [ns]
    arrival: np.ndarray  # (N,) int: times of recording [ns]
    values: np.ndarray  # (N, ...)

    @property
    def delay(self) -> Array:
        """Delays (N,) from stamps to times of recording [s]."""
        return np.asarray((self.arrival - self.stamp) / 1e9)

    @property
    def changes(self) -> np.ndarray:
        """Rows (n,) whose values differ from the row before, including the first row."""
        return np.flatnonzero(np.append(True, (self.values[1:] != self.values[:-1]).any(axis=1)))

    def take(self, rows: np.ndarray) -> Self:
        """Select readings by rows (n,) or by a mask (N,)."""
        return replace(
            self, stamp=self.stamp[rows], arrival=self.arrival[rows], values=self.values[rows]
        )

    def ascending(self, notes: list[str]) -> Self:
        """Select the largest set of readings whose stamps ascend in the order of recording.

        Adds a line to `notes`, once, for each reason why readings are left out. Raises LogError if
        most stamps are 0.
        """
        stamp, lines, zero = self.stamp, [], self.stamp == 0
        if zero.mean() > 0.5:
            raise LogError(
                f"topic {self.source}: {zero.sum()} of its {len(stamp)} header stamps are 0: its "
                "publisher states no "
                "time, or runs on simulated time that nothing publishes"
            )
        if zero.any():
            lines.append(
                f"{zero.sum()} of {len(stamp)} messages left out: their header stamps are 0"
            )
        rows = np.argsort(self.arrival, kind="stable")
        rows = rows[~zero[rows]]
        kept = rows[in_order(stamp[rows])]
        if len(kept) < len(rows):
            k = int(np.argmax(np.diff(stamp[rows]) <= 0)) + 1
            what = "is stamped twice" if stamp[rows[k]] == stamp[rows[k - 1]] else "goes back"
            at = f"{(stamp[rows[k]] - stamp[rows[0]]) / 1e9:.6g} s"
            lines.append(
                f"{len(rows) - len(kept)} of {len(rows)} messages left out: time {what} at {at}"
            )
        notes += [
            line for line in (f"topic {self.source}: {line}" for line in lines) if line not in notes
        ]
        return self.take(kept)

    def breaks(self) -> tuple[np.ndarray, np.ndarray]:
        """Times of recording [ns] at which the clock of the stamps restarts (n,), and at which it
        has a gap (m,); another drive begins at each.
        """
        rows = np.argsort(self.arrival, kind="stable")
        rows = rows[self.stamp[rows] != 0]
        time = seconds(self.stamp[rows], int(self.stamp[rows].min(initial=0)))
        backwards = restarts(time)
        ahead = [
            section[in_order(time[section])]
            for section in np.split(np.arange(len(rows)), backwards)
        ]
        after_gaps = [section[gaps(time[section], self.source)] for section in ahead]
        return self.arrival[rows[backwards]], self.arrival[rows[np.concatenate(after_gaps)]]


def seconds(stamp: np.ndarray, origin: int) -> Array:
    """Convert stamps (n,) [ns] to times (n,) since `origin` [ns] in seconds."""
    return np.asarray((stamp - origin) / 1e9)


def without_bursts(stamp: np.ndarray) -> np.ndarray:
    """Rows of readings without bursts, given ascending stamps (N,) [ns]: only the last reading of
    each burst is kept.

    Messages that waited in a queue may be stamped microseconds apart. The last message is the
    latest reading, and a mean since the last reading of the previous burst is a valid speed.
    """
    interval = np.diff(stamp)
    apart = interval[interval > _SHORTEST]
    usual = np.median(apart) if len(apart) else 0.0
    return np.flatnonzero(np.append(interval >= _BURST * usual, True))


def clocks_apart(ours: Readings, theirs: Readings) -> list[str]:
    """Notes (one, or none) on clocks of two topics that differ by a constant, according to the
    messages' delays.

    A delay is the time from the stamp in a header to the recording, which has a common clock for
    both topics. Raises LogError if the stamps of the two topics do not overlap.
    """
    apart = abs(float(np.median(ours.delay) - np.median(theirs.delay)))
    spread = _spread(ours.delay) + _spread(theirs.delay)
    differ = apart > _APART + spread
    line = f"clocks differ by {apart:.1f} s by their receive stamps" if differ else ""
    overlap = ours.stamp[0] <= theirs.stamp[-1] and theirs.stamp[0] <= ours.stamp[-1]
    if overlap:
        return [f"topics {ours.source} and {theirs.source}: {line}"] if differ else []

    ours_simulated = ours.stamp[-1] < _SIMULATED
    theirs_simulated = theirs.stamp[-1] < _SIMULATED
    if ours_simulated != theirs_simulated:
        line = "different clocks, simulated and wall time"
    raise LogError(
        f"topic {ours.source} is stamped from {_range(ours)} and topic {theirs.source} from "
        f"{_range(theirs)}: {line or 'different clocks'}"
    )


def _spread(delay: Array) -> float:
    """Width of the middle half of delays (N,) [s]."""
    return float(np.ptp(np.percentile(delay, (25, 75))))


def _range(readings: Readings) -> str:
    """First and last stamp, in words."""
    first = readings.stamp[0] / 1e9
    last = readings.stamp[-1] / 1e9
    return f"{first:.3f} to {last:.3f} s"
