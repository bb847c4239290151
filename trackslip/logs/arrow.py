"""Arrow's arrays from the memory of NumPy's.

`pyarrow.array` would import pandas, which takes longer than writing the runs of the whole paper.
"""

from __future__ import annotations

import numpy as np
import pyarrow as pa


def arrow(values: np.ndarray) -> pa.Array:
    """Numbers or truth values (T,), as they are: NaN is no null."""
    if values.dtype == bool:
        return _array(pa.bool_(), len(values), np.packbits(values, bitorder="little"))
    return _array(pa.from_numpy_dtype(values.dtype), len(values), np.ascontiguousarray(values))


def repeated(text: str, times: int) -> pa.Array:
    """The same text in each of a number of rows."""
    word = text.encode()
    ends = len(word) * np.arange(times + 1)
    if ends[-1] > np.iinfo(np.int32).max:
        return pa.array([text] * times)
    return _array(pa.string(), times, ends.astype(np.int32), np.frombuffer(word * times, np.uint8))


def lists(values: np.ndarray, count: np.ndarray) -> pa.Array:
    """Lists of `count` (T,) numbers each, of all values (n,) in order."""
    ends = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
    return pa.ListArray.from_arrays(arrow(ends), arrow(values))


def _array(kind: pa.DataType, length: int, *buffers: np.ndarray) -> pa.Array:
    return pa.Array.from_buffers(kind, length, [None, *map(pa.py_buffer, buffers)])
