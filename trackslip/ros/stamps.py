"""Stamps of messages: in order, of one clock, not zero."""

from __future__ import annotations

import numpy as np

from trackslip.errors import LogError
from trackslip.kinematics import Array
from trackslip.logs.checks import in_order, restarts

_BEGINS = 10**10  # latest second stamp of a clock that begins at 0 [ns]
_MOST = 0.5  # share of messages out of order or without stamp above which a topic can't be read
_LATE = 1.0  # time by which a message may be out of order to be sorted [s]
_SIMULATED = 10**17  # stamps before, in 1973, are of a simulation [ns]


def seconds(stamp: np.ndarray, origin: int) -> Array:
    """Times (n,) since the origin [s] of stamps (n,) [ns]."""
    return np.asarray((stamp - origin) / 1e9)


def stretches(topic: str, stamp: np.ndarray, arrival: np.ndarray, notes: list[str]) -> list[np.ndarray]:
    """Rows (n,) of a topic's messages by ascending stamp, for each stretch between restarts of the clock.

    Arguments are those of `clock_parts`. Raises LogError if most messages have no stamp, or are out of order.
    """
    return [part[ascending(topic, stamp[part], notes)] for part in clock_parts(topic, stamp, arrival, notes)]


def clock_parts(topic: str, stamp: np.ndarray, arrival: np.ndarray, notes: list[str]) -> list[np.ndarray]:
    """Rows (n,) of a topic's messages by arrival, for each stretch between restarts of the clock.

    Args:
        topic: name for messages.
        stamp: (N,) in the headers [ns].
        arrival: (N,) when the messages were recorded [ns].
        notes: gets a line for what is left out.

    Raises:
        LogError: if most messages have no stamp.
    """
    if not len(stamp):
        raise LogError(f"topic {topic}: no messages")
    rows, zero = np.argsort(arrival, kind="stable"), stamp == 0
    count = int(zero.sum())
    if count > max(_MOST * len(stamp), 1):
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
    """Rows (n,) by ascending stamp, of all stamps (N,) but repeated ones and those more than _LATE out of order.

    `notes` gets a line for those sorted and one for those left out, if it hasn't got it. Raises LogError if most
    different stamps are out of order.
    """
    kept = np.asarray(in_order(stamp))
    if len(kept) == len(stamp):
        return kept
    time = seconds(stamp, int(stamp[0]))
    others = np.setdiff1d(np.arange(len(stamp)), kept)
    late = others[np.abs(time[others] - np.interp(others, kept, time[kept])) <= _LATE]
    rows = np.union1d(kept, late)
    rows = rows[np.unique(stamp[rows], return_index=True)[1]]
    k = int(np.argmax(np.diff(stamp) <= 0)) + 1
    what = "is stamped twice" if stamp[k] == stamp[k - 1] else f"goes back from {time[k - 1]:.6g} s"
    line, lines = f"time {what} at {time[k]:.6g} s", []
    different = len(np.unique(stamp))  # a bag may hold all messages several times
    if different - len(kept) > _MOST * different:
        raise LogError(f"topic {topic}: {line}; so do {len(others)} of its {len(stamp)} messages")
    if moved := np.isin(rows, late).sum():
        lines.append(f"topic {topic}: {moved} of {len(stamp)} messages sorted by their stamps: {line}")
    if left_out := len(stamp) - len(rows):
        lines.append(f"topic {topic}: {left_out} of {len(stamp)} messages left out: {line}")
    notes += [line for line in lines if line not in notes]
    return rows


def require_overlap(topic: str, stamp: np.ndarray, other: str, theirs: np.ndarray) -> None:
    """Raise LogError if the stamps (n,) [ns] of two topics have no time in common."""
    if stamp[0] <= theirs[-1] and theirs[0] <= stamp[-1]:
        return
    one, two = (f"{times[0] / 1e9:.3f} to {times[-1] / 1e9:.3f} s" for times in (stamp, theirs))
    mixed = (stamp[-1] < _SIMULATED) != (theirs[-1] < _SIMULATED)
    which = ", simulated and wall time" if mixed else ""
    raise LogError(f"topic {topic} is stamped from {one} and topic {other} from {two}: different clocks{which}")
