"""Whatever is in a log: samples or one line that says why not, never a traceback."""

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.source import ReadOptions, read_source
from trackslip.kinematics import advance

READING = ReadOptions(half_gauge=0.168, sprocket_radius=0.06)
NUMBERS = ("t", "omega_l", "omega_r", "x", "y", "phi")
ROWS = 150
ODD = (None, float("nan"), float("inf"), -float("inf"), 0.0, -1.0, 1e300, -1e308, 1e-300, 1e9, "oops", "", " ", "1,5")


def sound():
    """Columns of three runs on circles, as lists."""
    columns = {name: [] for name in ("run", *NUMBERS, "valid")}
    for k, (v, w) in enumerate([(0.2, 0.1), (0.1, -0.2), (0.15, 0.0)]):
        time = np.arange(ROWS // 3) * 0.15
        pose = advance([k, 0.0, 0.5], np.array([v, w]), time)
        omega = (v + np.array([-1, 1]) * 0.21 * w) / 0.06
        values = np.column_stack([time, np.tile(omega, (len(time), 1)), pose])
        columns["run"] += [f"run {k}"] * len(time)
        columns["valid"] += [True] * len(time)
        for name, column in zip(NUMBERS, values.T, strict=True):
            columns[name] += column.tolist()
    return columns


@st.composite
def damage(draw):
    """A kind of damage, and where."""
    kind = draw(
        st.sampled_from(
            ("cells", "constant", "scaled", "shuffled", "doubled", "short", "type", "missing", "back", "named")
        )
    )
    names = draw(st.lists(st.sampled_from((*NUMBERS, "run", "valid")), min_size=1, max_size=3))
    rows = draw(st.lists(st.integers(0, ROWS - 1), min_size=1, max_size=20))
    return kind, names, rows, draw(st.sampled_from(ODD)), draw(st.integers(0, 99))


def damaged(columns, kind, names, rows, value, seed):
    """The columns with one damage more."""
    count = len(next(iter(columns.values())))
    rng = np.random.default_rng(seed)
    rows = [row for row in rows if row < count]
    if kind == "shuffled":
        order = rng.permutation(count) if seed % 2 else np.roll(np.arange(count), seed)
        return {name: [column[k] for k in order] for name, column in columns.items()}
    if kind == "doubled":
        order = sorted([*range(count), *rows])
        return {name: [column[k] for k in order] for name, column in columns.items()}
    if kind == "short":
        return {name: column[: seed % 8] for name, column in columns.items()}
    if kind == "back" and "t" in columns:
        numbers = [value if isinstance(value, float) else 0.0 for value in columns["t"]]
        return columns | {"t": [number - 3.0 * (k > 70) for k, number in enumerate(numbers)]}
    for name in sorted(set(names) & set(columns)):
        column = list(columns[name])
        if kind == "cells":
            for row in rows:
                column[row] = value
        elif kind == "constant":
            column = [value] * count
        elif kind == "scaled":
            factor = (1e300, 1e20, 1e6, 1e-6, 1e-300, -1.0)[seed % 6]
            column = [cell * factor if isinstance(cell, float) else cell for cell in column]
        elif kind == "type":
            column = [((True, [1.0], 3, "4", b"x")[seed % 5])] * count
        elif kind == "named":
            column = [f"{k % (1 + seed)}" for k in range(count)] if name == "run" else column
        if kind == "missing":
            columns = {key: cells for key, cells in columns.items() if key != name}
        else:
            columns = columns | {name: column}
    return columns


def as_array(column):
    """A column of one type, of text if its cells have several."""
    try:
        return pa.array(column)
    except (pa.ArrowException, TypeError, ValueError):
        return pa.array([None if cell is None else str(cell) for cell in column], pa.string())


def check(folder, damages, parquet):
    columns = sound()
    for kind in damages:
        columns = damaged(columns, *kind)
    path = folder / ("log.parquet" if parquet else "log.csv")
    arrays = {name: as_array(column) for name, column in columns.items()}
    if parquet:
        pa.parquet.write_table(pa.table(arrays), path)
    else:
        text = [[("" if cell is None else str(cell)) for cell in array.to_pylist()] for array in arrays.values()]
        path.write_text("\n".join([",".join(arrays), *(",".join(row) for row in zip(*text, strict=True))]))
    lines, sampling = [], None
    try:
        sampling = read_source(path, READING).sampling
    except (LogError, InvalidValueError) as error:
        lines = [str(error)]
    if sampling is not None:
        assert len(sampling.samples) > 0
        assert np.isfinite(sampling.samples.twist).all()
        assert np.isfinite(sampling.samples.omega).all()
        lines = [*sampling.notes, *map(str, sampling.refused)]
    for line in lines:
        assert "\n" not in line
        assert 10 < len(line) < 600


DAMAGES = st.lists(damage(), min_size=1, max_size=4)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(DAMAGES, st.booleans())
def test_a_malformed_log_gets_one_line(tmp_path_factory, damages, parquet):
    check(tmp_path_factory.mktemp("log"), damages, parquet)


@pytest.mark.slow
@settings(max_examples=1000, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(DAMAGES, st.booleans())
def test_a_thousand_malformed_logs_get_one_line(tmp_path_factory, damages, parquet):
    check(tmp_path_factory.mktemp("log"), damages, parquet)


@pytest.mark.parametrize("parquet", [False, True])
def test_the_sound_log_gives_a_sample_a_run(tmp_path, parquet):
    check(tmp_path, [], parquet)
    path = tmp_path / ("log.parquet" if parquet else "log.csv")
    assert read_source(path, READING).sampling.samples.run == ("run 0", "run 1", "run 2")
