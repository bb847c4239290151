"""Arrow's arrays from NumPy's memory, without pandas."""

import subprocess
import sys

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackslip.logs.arrow import arrow, lists, repeated

WRITES = """
import io, sys
import numpy as np
from trackslip.logs.logfile import write_parquet
from trackslip.logs.runlog import RunLog
write_parquet([RunLog("a", np.arange(3.0), np.zeros((3, 2)), np.zeros((3, 3)), valid=np.ones(3, bool))], io.BytesIO())
sys.exit("pandas" in sys.modules)
"""


@given(st.lists(st.floats(width=64), max_size=40))
def test_numbers_are_kept_to_the_bit(values):
    array = np.array(values, float)
    assert arrow(array).to_numpy().tobytes() == array.tobytes()
    assert arrow(array).null_count == 0


@pytest.mark.parametrize("kind", [np.int8, np.uint16, np.int32, np.int64, np.float32])
def test_kinds(kind):
    array = np.arange(7).astype(kind)
    assert arrow(array[::2]).equals(pa.array(array[::2]))


@given(st.lists(st.booleans(), max_size=40))
def test_truth_values(values):
    assert arrow(np.array(values, bool)).to_pylist() == values


@given(st.text(st.characters(exclude_categories=["Cs"])), st.integers(0, 20))
def test_texts(text, times):
    assert repeated(text, times).equals(pa.array([text] * times, pa.string()))


def test_lists():
    found = lists(np.arange(5, dtype=np.float32), np.array([2, 0, 3]))
    assert found.to_pylist() == [[0, 1], [], [2, 3, 4]]


def test_writing_runs_does_not_import_pandas():
    assert subprocess.run([sys.executable, "-c", WRITES], check=False).returncode == 0
