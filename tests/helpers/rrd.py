"""Reading recordings."""

from pathlib import Path

import numpy as np
import pyarrow as pa
from rerun.chunk import RrdReader


def component(file: Path, entity: str, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Times (T,) [s] and values (T, n) of an entity's component, with n values in every row."""
    times = []
    values = []
    for chunk in RrdReader(file).stream().filter(content=entity):
        batch = chunk.to_record_batch()
        column = [c for c in batch.schema.names if c.endswith(f":{name}")]
        if column and "time" in batch.schema.names:
            flat = batch.column(column[0]).flatten()
            while pa.types.is_nested(flat.type):
                flat = flat.flatten()
            values.append(np.asarray(flat).reshape(batch.num_rows, -1))
            times.append(batch.column("time").cast("int64").to_numpy() / 1e9)
    order = np.argsort(np.concatenate(times))
    return np.concatenate(times)[order], np.concatenate(values)[order]


def static(file: Path, entity: str, name: str) -> list:
    """The values of an entity's component that hold at all times."""
    for chunk in RrdReader(file).stream().filter(content=entity):
        batch = chunk.to_record_batch()
        column = [c for c in batch.schema.names if c.endswith(f":{name}")]
        if chunk.is_static and column:
            (values,) = batch.column(column[0]).to_pylist()
            return values
    raise KeyError(f"{entity} has no {name}")
