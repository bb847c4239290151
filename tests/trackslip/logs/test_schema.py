"""Units and descriptions of all columns, loading in one line, and files that are damaged."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

import trackslip
from trackslip.errors import LogError
from trackslip.localization.scan import Plate, extract_plate
from trackslip.logs.logfile import RUNS, join_parquet, write_csv, write_parquet
from trackslip.logs.runlog import RunLog, Truth
from trackslip.logs.scanlog import ScanLog
from trackslip.logs.schema import COLUMNS, NO_UNIT, PURE, markdown

DOCS = Path(__file__).parents[3] / "docs" / "data.md"
OF_SAMPLES = {"v", "w", "slip_l", "slip_r"}
ROWS = 40


@pytest.fixture(scope="module")
def full(scan_rectangle):
    """A run with everything that a log can hold."""
    rng = np.random.default_rng(0)
    pose = np.column_stack([np.full(ROWS, 2.0), np.zeros(ROWS), np.linspace(0.5, 1.0, ROWS)])
    scan = scan_rectangle(pose, rng)
    two, three = rng.normal(size=(ROWS, 2)), rng.normal(size=(ROWS, 3))
    seen = replace(scan, ranges=np.empty((0, len(scan.bearings))))
    scans = ScanLog(seen, Plate(), extract_plate(scan, Plate()), full=scan.ranges)
    return RunLog(
        "r",
        0.1 * np.arange(ROWS),
        two,
        pose,
        command=two,
        twist_command=two,
        icr=two,
        covariance=np.tile(np.eye(3), (ROWS, 1, 1)),
        valid=np.ones(ROWS, bool),
        load=two,
        gyro=two[:, 0],
        truth=Truth(pose, three, two, two, two, two, three[:, 0], np.ones((ROWS, 20, 3)), np.ones((ROWS, 20))),
        scans=scans,
        metadata={"seed": 1},
    )


@pytest.fixture
def stored(full, tmp_path):
    """The same in a folder of results."""
    write_parquet([full], tmp_path / RUNS)
    return tmp_path / RUNS


def test_every_column_that_is_written_has_a_unit_and_a_description(stored):
    schema = pyarrow.parquet.read_schema(stored)
    assert set(schema.names) == set(COLUMNS) - OF_SAMPLES
    for field in schema:
        assert field.metadata[b"unit"].decode() == COLUMNS[field.name].unit
        assert len(field.metadata[b"description"]) > 5


def test_what_has_no_unit_is_no_number(stored):
    schema = pyarrow.parquet.read_schema(stored)
    without = {name for name in schema.names if COLUMNS[name].unit == NO_UNIT}
    assert without == {"run", "valid"}
    for field in schema:
        if COLUMNS[field.name].unit == PURE:
            assert pa.types.is_floating(field.type) or pa.types.is_integer(field.type)


def test_units_are_in_the_files_own_metadata_too_and_survive_joining(stored, tmp_path, full):
    other = tmp_path / "other.parquet"
    write_parquet([replace(full, run="s", scans=None)], other)
    join_parquet([(stored, "r", "r"), (other, "s", "t")], tmp_path / "joined.parquet")
    schema = pyarrow.parquet.read_schema(tmp_path / "joined.parquet")
    about = json.loads(schema.metadata[b"trackslip"])
    assert about["columns"]["true_w"]["unit"] == "rad/s"
    assert set(about["columns"]) == set(schema.names)
    assert schema.field("ranges").metadata[b"unit"] == b"m"
    assert [log.run for log in trackslip.load(tmp_path / "joined.parquet")] == ["r", "t"]


def test_the_documented_table_is_the_schema():
    text = DOCS.read_text(encoding="utf-8")
    assert text.count(f"\n{markdown(COLUMNS.values())}\n") == 1


def test_loading_takes_one_line_folders_and_files(stored, tmp_path, full):
    write_csv([full], tmp_path / "runs.csv")
    for path in (tmp_path, str(tmp_path), stored, tmp_path / "runs.csv"):
        (log,) = trackslip.load(path)
        np.testing.assert_array_equal(log.pose, full.pose)


def test_pandas_and_polars_read_it(stored, full):
    pandas, polars = pytest.importorskip("pandas"), pytest.importorskip("polars")
    np.testing.assert_array_equal(pandas.read_parquet(stored)[["x", "y", "phi"]].to_numpy(), full.pose)
    np.testing.assert_array_equal(polars.read_parquet(stored).select("x", "y", "phi").to_numpy(), full.pose)
    about = json.loads(polars.read_parquet_metadata(stored)["trackslip"])
    assert about["columns"]["x"]["unit"] == "m"


def damaged(good):
    """What may become of a file, by name."""
    schema_only = pa.BufferOutputStream()
    pyarrow.parquet.write_table(pa.table({"a": [1.0], "b": ["x"]}), schema_only)
    wrong = pa.BufferOutputStream()
    columns = {name: ["far"] for name in ("run", "t", "omega_l", "omega_r", "x", "y", "phi")}
    pyarrow.parquet.write_table(pa.table(columns), wrong)
    middle = len(good) // 2
    return {
        "truncated": good[:middle],
        "end only": good[middle:],
        "a byte short": good[:-1],
        "random": np.random.default_rng(0).bytes(5000),
        "empty": b"",
        "a block overwritten": good[:middle] + bytes(64) + good[middle + 64 :],
        "other columns": schema_only.getvalue().to_pybytes(),
        "wrong types": wrong.getvalue().to_pybytes(),
    }


@pytest.mark.parametrize("what", damaged(b"PAR1" * 9))
def test_damaged_files_are_refused_in_one_line(stored, what):
    content = damaged(stored.read_bytes())[what]
    stored.write_bytes(content)
    for path in (stored, stored.parent):
        with pytest.raises(LogError) as caught:
            trackslip.load(path)
        assert str(stored) in str(caught.value)
        assert "\n" not in str(caught.value)
    assert stored.read_bytes() == content


def test_no_flipped_bit_changes_a_run_unnoticed(stored, full):
    good = stored.read_bytes()
    rng = np.random.default_rng(0)
    seen = 0
    for place in rng.integers(len(good), size=60):
        bad = bytearray(good)
        bad[place] ^= 1 << rng.integers(8)
        stored.write_bytes(bad)
        try:
            (log,) = trackslip.load(stored)
        except LogError:
            seen += 1
        else:
            np.testing.assert_array_equal(log.pose, full.pose)
            np.testing.assert_array_equal(log.omega, full.omega)
    assert seen > 30


def test_a_folder_without_runs(tmp_path):
    with pytest.raises(LogError, match=r"there is no runs\.parquet in this folder"):
        trackslip.load(tmp_path)
    with pytest.raises(LogError, match="no such file"):
        trackslip.load(tmp_path / "none")
