"""Ticks that were counted since the last reading, and rows in no order."""

import numpy as np
import pyarrow as pa
import pytest
from plain_drives import DRIVE, ENCODER_STEP

from trackslip.errors import LogError
from trackslip.logs.changes import are_changes
from trackslip.logs.layout import Layout
from trackslip.logs.table_reader import runs_from_table

ANGLES = np.cumsum(DRIVE.omega, axis=0) * ENCODER_STEP


def ticks(per_turn):
    return np.floor(ANGLES * per_turn / (2 * np.pi))


def table(counts):
    time = np.arange(len(counts)) * ENCODER_STEP
    still = np.zeros(len(counts))
    left, right = counts.T
    return pa.table({"t": time, "ticks_l": left, "ticks_r": right, "x": still, "y": still})


@pytest.mark.parametrize("per_turn", [200, 1440])
def test_counts_since_the_last_reading_are_refused(per_turn):
    changes = np.diff(ticks(per_turn), axis=0, prepend=0)
    with pytest.raises(LogError, match=r"ticks_l, ticks_r: look like changes .*running sums"):
        runs_from_table(table(changes), "log", layout=Layout(ticks_per_turn=per_turn))


@pytest.mark.parametrize(
    ("per_turn", "size"),
    [(12, None), (48, 256), (200, None), (200, 256), (1440, 4096), (100_000, None)],
)
def test_sums_of_counts_are_no_changes(per_turn, size):
    for side in ticks(per_turn).T:
        assert not are_changes(side if size is None else side % size)


def test_few_readings_tell_nothing():
    assert not are_changes(np.tile([3.0, 2.0], 20))


def test_rows_in_no_order_are_sorted():
    rows = table(ticks(1440))
    shuffled = rows.take(np.random.default_rng(0).permutation(len(rows)))
    layout = Layout(ticks_per_turn=1440)
    (run,) = runs_from_table(rows, "log", layout=layout).runs
    read = runs_from_table(shuffled, "log", layout=layout)
    (sorted_run,) = read.runs
    np.testing.assert_allclose(sorted_run.omega, run.omega)
    assert read.notes[0] == "run 'log': rows are not in the order of t, and are sorted"
