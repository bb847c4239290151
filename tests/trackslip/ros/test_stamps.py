"""Messages that were recorded late, twice, or with a stamp of another time."""

from __future__ import annotations

import numpy as np

from trackslip.ros.stamps import ascending

STAMP = 10**18 + 20_000_000 * np.arange(2000)


def test_late_messages_are_sorted_and_none_is_lost():
    rng, notes = np.random.default_rng(0), []
    recorded = STAMP[np.argsort(STAMP + rng.uniform(0, 2e8, len(STAMP)))]
    rows = ascending("/odom", recorded, notes)
    np.testing.assert_array_equal(recorded[rows], STAMP)
    assert len(notes) == 1
    assert " of 2000 messages sorted by their stamps: time goes back from " in notes[0]


def test_repeated_and_misplaced_messages_are_left_out():
    notes = []
    recorded = np.insert(STAMP, 1000, [STAMP[999], STAMP[500], STAMP[1500]])
    np.testing.assert_array_equal(recorded[ascending("/odom", recorded, notes)], STAMP)
    assert notes == ["topic /odom: 3 of 2003 messages left out: time is stamped twice at 19.98 s"]
