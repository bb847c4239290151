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

    source: str
    """The topic, or tf:PARENT:CHILD."""
    stamp: np.ndarray  # (N,) int: stamps in the headers, ascending [ns]
    delay: Array  # times from the stamps of the messages to their recording [s]


def seconds(stamp: np.ndarray, origin: int) -> Array:
    """Times (n,) since the origin [s] of stamps (n,) [ns]."""
    return np.asarray((stamp - origin) / 1e9)


def stretches(topic: str, stamp: np.ndarray, arrival: np.ndarray, notes: list[str]) -> list[np.ndarray]:
    """Rows (n,) of a topic's messages by ascending stamp, for each stretch between restarts of the clock.

    Stamps (N,) are those in the headers, arrivals (N,) the times of recording [ns]. `notes` gets a line for what is
    left out, if it hasn't got it. Raises LogError if most messages have no stamp.
    """
    if not len(stamp):
        raise LogError(f"topic {topic}: no messages")
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
    time = seconds(stamp[rows], int(stamp[rows].min()))
    starts = restarts(time)
    if starts.size:
        back = f"from {time[starts[0] - 1]:.6g} s to {time[starts[0]]:.6g} s"
        lines.append(f"time goes back {back}: read as {starts.size + 1} drives")
    parts = []
    for part in np.split(rows, starts):
        parts.append(part[in_order(stamp[part])])
        if len(parts[-1]) < len(part):
            k = int(np.argmax(np.diff(stamp[part]) <= 0)) + 1
            what = "is stamped twice" if stamp[part[k]] == stamp[part[k - 1]] else "goes back"
            at = f"{(stamp[part[k]] - stamp[part[0]]) / 1e9:.6g} s"
            count = len(part) - len(parts[-1])
            lines.append(f"{count} of {len(part)} messages left out: time {what} at {at}")
    notes += [line for line in (f"topic {topic}: {line}" for line in lines) if line not in notes]
    return parts


def without_bursts(stamp: np.ndarray) -> np.ndarray:
    """Rows of the last reading of each burst, of ascending stamps (N,) [ns].

    Messages that waited in a queue may be stamped microseconds apart. The last of them is the latest reading, and the
    mean since the last one of the burst before is a speed.
    """
    interval = np.diff(stamp)
    apart = interval[interval > _SHORTEST]
    usual = np.median(apart) if len(apart) else 0.0
    return np.flatnonzero(np.append(interval >= _BURST * usual, True))


def clocks_apart(ours: Stamped, theirs: Stamped) -> str:
    """A line on clocks that differ by a constant, by the delays of two topics' messages; empty if they don't.

    Delays are the times from the stamps in the headers to the recording, by the recorder's one clock. Raises LogError
    if the stamps have no time in common.
    """
    apart = abs(float(np.median(ours.delay) - np.median(theirs.delay)))
    spread = sum(float(np.ptp(np.percentile(topic.delay, (25, 75)))) for topic in (ours, theirs))
    line = f"clocks differ by {apart:.1f} s by their receive stamps" if apart > _APART + spread else ""
    if ours.stamp[0] <= theirs.stamp[-1] and theirs.stamp[0] <= ours.stamp[-1]:
        return f"topics {ours.source} and {theirs.source}: {line}" if line else ""
    if (ours.stamp[-1] < _SIMULATED) != (theirs.stamp[-1] < _SIMULATED):
        line = "different clocks, simulated and wall time"
    first, second = (f"{topic.stamp[0] / 1e9:.3f} to {topic.stamp[-1] / 1e9:.3f} s" for topic in (ours, theirs))
    raise LogError(
        f"topic {ours.source} is stamped from {first} and topic {theirs.source} from {second}: "
        f"{line or 'different clocks'}"
    )
