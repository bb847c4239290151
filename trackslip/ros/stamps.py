"""Stamps of messages: in order, of one clock, not zero."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackslip.errors import LogError
from trackslip.logs.checks import in_order, restarts

_BEGINS = 10**10  # latest second stamp of a clock that begins at 0 [ns]
_MOST = 0.5  # share of messages out of order or without stamp above which a topic can't be read


def seconds(stamp: np.ndarray, origin: int) -> np.ndarray:
    """Times (n,) since the origin [s] of stamps (n,) [ns]."""
    return (stamp - origin) / 1e9


def stretches(topic: str, stamp: np.ndarray, arrival: np.ndarray, notes: list[str]) -> list[np.ndarray]:
    """Rows (n,) of a topic's messages by ascending stamp, for each stretch between restarts of the clock.

    Arguments are those of `clock_parts`. Raises LogError if most messages have no stamp, or are out of order.
    """
    return [part[ascending(topic, stamp[part], notes)] for part in clock_parts(topic, stamp, arrival, notes)]


def clock_parts(topic: str, stamp: np.ndarray, arrival: np.ndarray, notes: list[str]) -> list[np.ndarray]:
    """Rows (n,) of a topic's messages by arrival, for each stretch between restarts of the clock.

    Args:
        topic: name in messages.
        stamp: (N,) in the headers [ns].
        arrival: (N,) when the messages were recorded [ns].
        notes: gets a line for what is left out.

    Raises:
        LogError: if most messages have no stamp.
    """
    if not len(stamp):
        raise LogError(f"topic {topic}: no messages")
    rows = np.argsort(arrival, kind="stable")
    rows = _stamped(topic, stamp, rows, notes)
    time = seconds(stamp[rows], int(stamp[rows].min()))
    starts = restarts(time)
    if starts.size:
        k = int(starts[0])
        origin = int(stamp[rows].min())
        back = f"from {_shown(stamp[rows[k - 1]], origin)} to {_shown(stamp[rows[k]], origin)}"
        notes.append(f"topic {topic}: time goes back {back}: read as {starts.size + 1} drives")
    return list(np.split(rows, starts))


def _stamped(topic: str, stamp: np.ndarray, rows: np.ndarray, notes: list[str]) -> np.ndarray:
    """The rows whose stamps aren't zero."""
    zero = int((stamp == 0).sum())
    if zero > max(_MOST * len(stamp), 1):
        raise LogError(
            f"topic {topic}: {zero} of its {len(stamp)} header stamps are 0: its publisher states no time, "
            "or runs on simulated time that nothing publishes"
        )
    begins = zero == 1 and 0 < stamp[stamp != 0].min(initial=np.iinfo(np.int64).max) < _BEGINS  # simulated time
    if zero and not begins and zero < len(stamp):
        notes.append(f"topic {topic}: {zero} of {len(stamp)} messages left out: their header stamps are 0")
        return rows[stamp[rows] != 0]
    return rows


def ascending(topic: str, stamp: np.ndarray, notes: list[str]) -> np.ndarray:
    """As many rows (n,) as possible whose stamps (N,) ascend; raises LogError if most different stamps don't.

    `notes` gets a line for those left out, if it hasn't got it.
    """
    kept = in_order(stamp)
    left_out = len(stamp) - len(kept)
    if left_out:
        origin = int(stamp[0])
        k = int(np.argmax(np.diff(stamp) <= 0)) + 1
        what = "is stamped twice" if stamp[k] == stamp[k - 1] else f"goes back from {_shown(stamp[k - 1], origin)}"
        line = f"time {what} at {_shown(stamp[k], origin)}"
        different = len(np.unique(stamp))  # a bag may hold all messages several times
        if different - len(kept) > _MOST * different:
            raise LogError(f"topic {topic}: {line}; so do {left_out} of its {len(stamp)} messages")
        line = f"topic {topic}: {left_out} of {len(stamp)} messages left out: {line}"
        notes += [line] if line not in notes else []
    return np.asarray(kept)


def _shown(stamp: int, origin: int) -> str:
    """A stamp for a message, since the origin unless that is simulated time."""
    return f"{(stamp - origin) / 1e9:.6g} s"


def require_overlap(first: tuple[str, np.ndarray], second: tuple[str, np.ndarray]) -> None:
    """Raise LogError if the stamps (n,) [ns] of two topics, each with its name, have no time in common."""
    (name, stamp), (other, theirs) = first, second
    if stamp[0] <= theirs[-1] and theirs[0] <= stamp[-1]:
        return
    spans = " and ".join(
        f"topic {topic} {verb} {times[0] / 1e9:.3f} to {times[-1] / 1e9:.3f} s"
        for topic, verb, times in ((name, "is stamped from", stamp), (other, "from", theirs))
    )
    raise LogError(f"{spans}: different clocks{_which(stamp, theirs)}")


def _which(*stamps: Sequence[int] | np.ndarray) -> str:
    """What clocks they seem to be, for a message."""
    simulated = [int(one[-1]) < 10**17 for one in stamps]  # before 1973
    return ", simulated and wall time" if simulated[0] != simulated[1] else ""
