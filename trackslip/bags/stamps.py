"""Stamps of messages: in order, of one clock, not zero, and not in bursts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.logs.checks import in_order, restarts

_SIMULATED = 10**17  # stamps before, in 1973, are of a simulation [ns]
_APART = 1.0  # difference of delays that isn't the time in which a scan is matched [s]
_BURST = 0.1  # interval by the usual one, below which readings came in a burst: speeds would be ten-fold
_SHORTEST = 500_000  # usual interval, half that of the fastest controllers, which run at 1 kHz [ns]


@dataclass(frozen=True)
class Stamped:
    """Readings by one clock."""

    source: str  # the topic, or tf:PARENT:CHILD
    stamp: np.ndarray  # (N,) int: stamps in the headers, ascending [ns]
    delay: Array  # times from the stamps of the messages to their recording [s]


def seconds(stamp: np.ndarray, origin: int) -> Array:
    """Times (n,) since the origin [s] of stamps (n,) [ns]."""
    return np.asarray((stamp - origin) / 1e9)


def restarts_of(stamp: np.ndarray, arrival: np.ndarray) -> np.ndarray:
    """Times of recording (n,) [ns] at which the clock of the stamps (N,) starts anew."""
    rows = np.argsort(arrival, kind="stable")
    rows = rows[stamp[rows] != 0]
    return np.asarray(arrival[rows[restarts(seconds(stamp[rows], int(stamp[rows].min(initial=0))))]])


def ascending(topic: str, stamp: np.ndarray, arrival: np.ndarray, notes: list[str]) -> np.ndarray:
    """Rows (n,) of a topic's messages by ascending stamp, of those recorded by one clock.

    Stamps (N,) are those in the headers, arrivals (N,) the times of recording [ns]. `notes` gets a line for what is
    left out, if it hasn't got it. Raises LogError if most messages have no stamp.
    """
    lines = []
    zero = stamp == 0
    if zero.mean() > 0.5:
        raise LogError(
            f"topic {topic}: {zero.sum()} of its {len(stamp)} header stamps are 0: its publisher states no time, "
            "or runs on simulated time that nothing publishes"
        )
    if zero.any():
        lines.append(f"{zero.sum()} of {len(stamp)} messages left out: their header stamps are 0")
    rows = np.argsort(arrival, kind="stable")
    rows = rows[~zero[rows]]
    kept = rows[in_order(stamp[rows])]
    if len(kept) < len(rows):
        k = int(np.argmax(np.diff(stamp[rows]) <= 0)) + 1
        what = "is stamped twice" if stamp[rows[k]] == stamp[rows[k - 1]] else "goes back"
        at = f"{(stamp[rows[k]] - stamp[rows[0]]) / 1e9:.6g} s"
        lines.append(f"{len(rows) - len(kept)} of {len(rows)} messages left out: time {what} at {at}")
    notes += [line for line in (f"topic {topic}: {line}" for line in lines) if line not in notes]
    return kept


def without_bursts(stamp: np.ndarray) -> np.ndarray:
    """Rows of the last reading of each burst, of ascending stamps (N,) [ns].

    Messages that waited in a queue may be stamped microseconds apart. The last of them is the latest reading, and the
    mean since the last one of the burst before is a speed.
    """
    interval = np.diff(stamp)
    apart = interval[interval > _SHORTEST]
    usual = np.median(apart) if len(apart) else 0.0
    return np.flatnonzero(np.append(interval >= _BURST * usual, True))


def clocks_apart(ours: Stamped, theirs: Stamped) -> list[str]:
    """A line on clocks that differ by a constant, by the delays of two topics' messages; none if they don't.

    Delays are the times from the stamps in the headers to the recording, by the recorder's one clock. Raises LogError
    if the stamps have no time in common.
    """
    apart = abs(float(np.median(ours.delay) - np.median(theirs.delay)))
    spread = sum(float(np.ptp(np.percentile(topic.delay, (25, 75)))) for topic in (ours, theirs))
    line = f"clocks differ by {apart:.1f} s by their receive stamps" if apart > _APART + spread else ""
    if ours.stamp[0] <= theirs.stamp[-1] and theirs.stamp[0] <= ours.stamp[-1]:
        return [f"topics {ours.source} and {theirs.source}: {line}"] if line else []
    if (ours.stamp[-1] < _SIMULATED) != (theirs.stamp[-1] < _SIMULATED):
        line = "different clocks, simulated and wall time"
    first, second = (f"{topic.stamp[0] / 1e9:.3f} to {topic.stamp[-1] / 1e9:.3f} s" for topic in (ours, theirs))
    raise LogError(
        f"topic {ours.source} is stamped from {first} and topic {theirs.source} from {second}: "
        f"{line or 'different clocks'}"
    )
