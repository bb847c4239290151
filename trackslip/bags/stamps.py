"""Stamps of messages: in order, of one clock, not zero, and not in bursts."""

from __future__ import annotations

import numpy as np
import scipy

from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.logs.checks import restarts

_BEGINS = 10**10  # latest second stamp of a clock that begins at 0 [ns]
_LATE = 1.0  # time by which a message may be out of order to be sorted [s]
_NEAR = 9  # messages around one, whose median stamp is about its own: those of `restarts`
_SIMULATED = 10**17  # stamps before, in 1973, are of a simulation [ns]
_APART = 1.0  # difference of delays that isn't the time in which a scan is matched [s]
_BURST = 0.1  # interval by the usual one, below which readings came in a burst: speeds would be ten-fold
_SHORTEST = 500_000  # usual interval, half that of the fastest controllers, which run at 1 kHz [ns]


def seconds(stamp: np.ndarray, origin: int) -> Array:
    """Times (n,) since the origin [s] of stamps (n,) [ns]."""
    return np.asarray((stamp - origin) / 1e9)


def stretches(topic: str, stamp: np.ndarray, arrival: np.ndarray, notes: list[str]) -> list[np.ndarray]:
    """Rows (n,) of a topic's messages by ascending stamp, for each stretch between restarts of the clock.

    Arguments are those of `clock_parts`. Raises LogError if most messages have no stamp.
    """
    return [part[ascending(topic, stamp[part], notes)] for part in clock_parts(topic, stamp, arrival, notes)]


def clock_parts(topic: str, stamp: np.ndarray, arrival: np.ndarray, notes: list[str]) -> list[np.ndarray]:
    """Rows (n,) of a topic's messages by arrival, for each stretch between restarts of the clock.

    Stamps (N,) are those in the headers, arrivals (N,) the times of recording [ns]; `notes` gets a line for what is
    left out. Raises LogError if most messages have no stamp.
    """
    if not len(stamp):
        raise LogError(f"topic {topic}: no messages")
    rows, zero = np.argsort(arrival, kind="stable"), stamp == 0
    count = int(zero.sum())
    if count > max(len(stamp) / 2, 1):
        raise LogError(
            f"topic {topic}: {count} of its {len(stamp)} header stamps are 0: its publisher states no time, "
            "or runs on simulated time that nothing publishes"
        )
    begins = count == 1 and 0 < stamp[~zero].min(initial=np.iinfo(np.int64).max) < _BEGINS  # simulated time
    if count and not begins and count < len(stamp):
        notes.append(f"topic {topic}: {count} of {len(stamp)} messages left out: their header stamps are 0")
        rows = rows[~zero[rows]]
    time = seconds(stamp[rows], int(stamp[rows].min()))
    starts = restarts(time)
    if starts.size:
        back = f"from {time[starts[0] - 1]:.6g} s to {time[starts[0]]:.6g} s"
        notes.append(f"topic {topic}: time goes back {back}: read as {starts.size + 1} drives")
    return list(np.split(rows, starts))


def ascending(topic: str, stamp: np.ndarray, notes: list[str]) -> np.ndarray:
    """Rows (n,) by ascending stamp, of all stamps (N,) but repeated ones and those far from their neighbours'.

    `notes` gets a line for those sorted and one for those left out, if it hasn't got it.
    """
    if (np.diff(stamp) > 0).all():
        return np.arange(len(stamp))
    time = seconds(stamp, int(stamp[0]))
    near = np.abs(time - scipy.ndimage.median_filter(time, size=_NEAR, mode="nearest")) <= _LATE
    rows = np.flatnonzero(near)
    rows = rows[np.unique(stamp[rows], return_index=True)[1]]
    k = int(np.argmax(np.diff(stamp) <= 0)) + 1
    what = "is stamped twice" if stamp[k] == stamp[k - 1] else f"goes back from {time[k - 1]:.6g} s"
    moved, left_out = int((np.diff(rows) < 0).sum()), len(stamp) - len(rows)
    for count, done in ((moved, "sorted by their stamps"), (left_out, "left out")):
        line = f"topic {topic}: {count} of {len(stamp)} messages {done}: time {what} at {time[k]:.6g} s"
        if count and line not in notes:
            notes.append(line)
    return rows


def without_bursts(stamp: np.ndarray) -> np.ndarray:
    """Rows of the last reading of each burst, of ascending stamps (N,) [ns].

    Messages that waited in a queue may be stamped microseconds apart. The last of them is the latest reading, and the
    mean since the last one of the burst before is a speed.
    """
    interval = np.diff(stamp)
    apart = interval[interval > _SHORTEST]
    usual = np.median(apart) if len(apart) else 0.0
    return np.flatnonzero(np.append(interval >= _BURST * usual, True))


def clocks_apart(delay: Array, other: Array) -> str:
    """Words on clocks that differ by a constant, by the delays of two topics' messages [s]; empty if they don't.

    Delays (N,) are the times from the stamps in the headers to the recording, by the recorder's one clock.
    """
    apart = float(np.median(delay) - np.median(other))
    spread = sum(float(np.ptp(np.percentile(values, (25, 75)))) for values in (delay, other))
    return f"clocks differ by {abs(apart):.1f} s by their receive stamps" if abs(apart) > _APART + spread else ""


def require_overlap(topic: str, stamp: np.ndarray, other: str, theirs: np.ndarray, apart: str = "") -> None:
    """Raise LogError if the stamps (n,) [ns] of two topics have no time in common; `apart` is from `clocks_apart`."""
    if stamp[0] <= theirs[-1] and theirs[0] <= stamp[-1]:
        return
    one, two = (f"{times[0] / 1e9:.3f} to {times[-1] / 1e9:.3f} s" for times in (stamp, theirs))
    mixed = (stamp[-1] < _SIMULATED) != (theirs[-1] < _SIMULATED)
    which = "different clocks, simulated and wall time" if mixed else apart or "different clocks"
    raise LogError(f"topic {topic} is stamped from {one} and topic {other} from {two}: {which}")
