"""Whatever is in a log or a drive: laws or one line that says why not, never a traceback."""

import json
import warnings
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest
from drives import GEOMETRY, SLAM, drive_log
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from trackslip.errors import InvalidValueError, LogError, TrackslipError
from trackslip.identification.identify import identify
from trackslip.identification.result import identification_to_json
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


DAMAGE = st.tuples(
    st.sampled_from(("cells", "constant", "scaled", "type", "missing", "back")),
    st.lists(st.sampled_from((*NUMBERS, "run", "valid")), min_size=1, max_size=3),
    st.lists(st.integers(0, ROWS - 1), min_size=1, max_size=20),
    st.sampled_from(ODD),
    st.integers(0, 5),
)
"""A kind of damage, its columns and rows, and what stands there."""


def damaged(columns, kind, names, rows, value, seed):
    """The columns with one damage more."""
    columns = {name: list(column) for name, column in columns.items()}
    for name in {"t"} & set(columns) if kind == "back" else sorted(set(names) & set(columns)):
        column = columns[name]
        numbers = [cell if isinstance(cell, float) else 0.0 for cell in column]
        if kind == "cells":
            columns[name] = [value if k in rows else cell for k, cell in enumerate(column)]
        elif kind == "constant":
            columns[name] = [value] * ROWS
        elif kind == "scaled":
            columns[name] = [number * (1e300, 1e20, 1e6, 1e-6, 1e-300, -1.0)[seed] for number in numbers]
        elif kind == "type":
            columns[name] = [(True, [1.0], 3, "4", b"x", None)[seed]] * ROWS
        elif kind == "back":
            columns[name] = [number - 3.0 * (k > 70) for k, number in enumerate(numbers)]
        else:
            del columns[name]
    return columns


def as_array(column):
    """A column of one type, of text if its cells have several."""
    try:
        return pa.array(column)
    except (pa.ArrowException, TypeError, ValueError):
        return pa.array([None if cell is None else str(cell) for cell in column], pa.string())


def read(folder, damages, parquet):
    """The sampling of a log with some damages, and the lines that are said of it."""
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
    try:
        sampling = read_source(path, READING).sampling
    except (LogError, InvalidValueError) as error:
        return None, [str(error)]
    return sampling, [*sampling.notes, *map(str, sampling.refused)]


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(DAMAGE, min_size=1, max_size=4), st.booleans())
def test_a_malformed_log_gets_one_line(tmp_path_factory, damages, parquet):
    sampling, lines = read(tmp_path_factory.mktemp("log"), damages, parquet)
    assert all("\n" not in line and 10 < len(line) < 600 for line in lines)
    if sampling is not None:
        assert len(sampling.samples) > 0
        assert np.isfinite([sampling.samples.twist, sampling.samples.omega]).all()


@pytest.mark.parametrize("parquet", [False, True])
def test_the_sound_log_gives_a_sample_a_run(tmp_path, parquet):
    assert read(tmp_path, [], parquet)[0].samples.run == ("run 0", "run 1", "run 2")


@pytest.fixture(autouse=True)
def few_laws(monkeypatch):
    """Fit few laws, as others have the same data."""
    monkeypatch.setattr("trackslip.identification.drive_comparison.drive_laws", lambda: ("none", "icr_radius"))


MISTAKES = {
    "few rows": lambda log, rng: log.between(0, int(rng.integers(2, 60))),
    "no headings": lambda log, rng: replace(log, pose=log.pose * [1, 1, np.nan]),
    "few headings": lambda log, rng: replace(
        log, pose=np.where(rng.random((len(log.time), 1)) < [0, 0, rng.choice([0.9, 0.999])], np.nan, log.pose)
    ),
    "few poses": lambda log, rng: replace(log, valid=log.is_valid & (rng.random(len(log.time)) < 0.1)),
    "swapped": lambda log, rng: replace(log, omega=log.omega[:, ::-1]),
    "units of speeds": lambda log, rng: replace(log, omega=log.omega * 10.0 ** rng.integers(-8, 9)),
    "units of places": lambda log, rng: replace(log, pose=log.pose * [*[10.0 ** rng.integers(-8, 9)] * 2, 1]),
    "units of headings": lambda log, rng: replace(log, pose=log.pose * [1, 1, rng.choice([0, 57.3, -1, 1e9])]),
    "units of times": lambda log, rng: replace(log, time=log.time * 10.0 ** rng.integers(-9, 10)),
    "one sprocket at rest": lambda log, rng: replace(log, omega=log.omega * [1, 0]),
    "nearly at rest": lambda log, rng: replace(log, omega=np.where(log.time[:, None] < 5, 0, log.omega)),
    "far away": lambda log, rng: replace(log, pose=log.pose + 10.0 ** rng.integers(3, 13, (1, 3)) * [1, 1, 0]),
    "poses at random": lambda log, rng: replace(log, pose=log.pose + rng.normal(size=log.pose.shape)),
    "jumps": lambda log, rng: replace(
        log, pose=log.pose + 10 * np.cumsum(rng.random((len(log.time), 1)) < 0.05)[:, None]
    ),
    "speeds at random": lambda log, rng: replace(log, omega=rng.normal(size=log.omega.shape) * 5),
    "gap": lambda log, rng: replace(log, time=log.time + 1e4 * (log.time > 3)),
    "same pose": lambda log, rng: replace(
        log, pose=np.where(log.time[:, None] > 5, log.pose[log.is_valid][0], log.pose)
    ),
}


@settings(
    max_examples=12,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
@example(["one sprocket at rest", "units of headings"], 14)  # a gain of turns of 0
@given(st.lists(st.sampled_from(sorted(MISTAKES)), min_size=1, max_size=3, unique=True), st.integers(0, 20))
def test_malformed_drives_end_in_laws_or_one_line(mistakes, seed):
    """Without a warning of NumPy's."""
    rng = np.random.default_rng(seed)
    message, driving = "", ("random", "eights", "stop_and_go", "loop")[seed % 4]
    log = drive_log(seed, 6.0, SLAM, driving=driving)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            for mistake in mistakes:
                log = MISTAKES[mistake](log, rng)
            found = identify(log, GEOMETRY, method="drive")
        except TrackslipError as error:
            message = str(error)
    assert "\n" not in message
    assert len(message) < 400
    if not message:
        json.dumps(identification_to_json(found))
        assert all(np.isfinite(list(fit.values.values())).all() for fit in found.drive.laws.values())
