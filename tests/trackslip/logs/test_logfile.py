"""Files of runs: every bit comes back, columns have units, and what is damaged is named in one line."""

import json
from dataclasses import replace
from pathlib import Path
from unittest.mock import ANY

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import trackslip
from trackslip.errors import LogError
from trackslip.localization.scan import Plate, extract_plate
from trackslip.logs.logfile import RUNS, StoredRuns, join_parquet, read_runs, write_csv, write_parquet
from trackslip.logs.runlog import RunLog, ScanLog, Truth
from trackslip.logs.schema import COLUMNS, NO_UNIT, PURE, markdown
from trackslip.logs.table import to_table
from trackslip.logs.table_reader import runs_from_table

DOCS = Path(__file__).parents[3] / "docs" / "data.md"
OF_SAMPLES = {"v", "w", "slip_l", "slip_r"}
ROWS = 40
HEADER = "run,t,omega_l,omega_r,x,y,phi\n"
LINES = ["a,0.0,1,2,0,0,0\n", "a,0.1,1,2,0.1,0,0\n", "a,0.2,1,2,0.2,0,0\n"]
WRITERS = [("runs.csv", write_csv), ("runs.parquet", write_parquet)]


@pytest.fixture(scope="module")
def full(scan_rectangle):
    """A run with everything that a log can hold."""
    rng = np.random.default_rng(0)
    pose = np.column_stack([np.full(ROWS, 2.0), np.zeros(ROWS), np.linspace(0.5, 1.0, ROWS)])
    scan = scan_rectangle(pose, rng)
    two, three, half = rng.normal(size=(ROWS, 2)), rng.normal(size=(ROWS, 3)), rng.normal(size=(ROWS, 3, 3))
    seen = replace(scan, ranges=np.empty((0, len(scan.bearings))))
    scans = ScanLog(seen, Plate(), extract_plate(scan, Plate()), full=scan.ranges)
    return RunLog(
        "a",
        np.cumsum(rng.uniform(0.01, 0.1, ROWS)),
        two,
        pose,
        command=two + 1,
        twist_command=two + 2,
        icr=two + 3,
        covariance=half @ half.swapaxes(1, 2),
        valid=rng.random(ROWS) > 0.2,
        load=two + 4,
        gyro=two[:, 0],
        truth=Truth(pose, three, two, two, two, two, three[:, 0], np.ones((ROWS, 20, 3)), np.ones((ROWS, 20))),
        scans=scans,
        metadata={"seed": 1, "geometry": {"half_gauge": 0.168}},
    )


@pytest.fixture
def stored(full, tmp_path):
    """The same in a folder of results."""
    write_parquet([full], tmp_path / RUNS)
    return tmp_path / RUNS


def assert_same(read, written):
    for name in ("run", "time", "omega", "pose", "command", "twist_command", "icr", "covariance", "valid", "load"):
        np.testing.assert_array_equal(getattr(read, name), getattr(written, name))
    assert (read.truth is None) == (written.truth is None)
    if written.truth is not None:
        for name in ("pose", "twist", "traction", "torque", "power", "saturated", "lean"):
            np.testing.assert_array_equal(getattr(read.truth, name), getattr(written.truth, name))


@pytest.mark.parametrize(("name", "write"), WRITERS)
def test_round_trip_is_exact_whatever_the_runs_have(tmp_path, full, name, write):
    full = replace(full, gyro=None)
    logs = [
        full,
        replace(full.between(3, 30), run="b", valid=None),
        replace(full, run="c", truth=None, covariance=None, scans=None),
        replace(full, run="d", load=None, command=None),
    ]
    write(logs, tmp_path / name)
    back = read_runs(tmp_path / name)
    for before, after in zip(logs, back, strict=True):
        assert_same(after, replace(before, valid=before.is_valid))
    if name.endswith("parquet"):
        assert [log.metadata for log in back] == [log.metadata for log in logs]
        np.testing.assert_array_equal(back[1].truth.contact, logs[1].truth.contact)
        np.testing.assert_array_equal(back[1].truth.shear, logs[1].truth.shear)
        np.testing.assert_array_equal(back[0].scans.cluster.count, full.scans.cluster.count)
        assert back[2].scans is None


@settings(max_examples=25)
@given(arrays(float, (2, 2), elements=st.floats(-1e21, 1e21)), st.floats(-1, 1))
def test_csv_keeps_every_bit(tmp_path_factory, position, heading):
    pose = np.column_stack([position, [heading, -heading]])
    path = tmp_path_factory.mktemp("csv") / "run.csv"
    write_csv([RunLog("r", np.array([0.0, 1.0]), np.ones((2, 2)), pose)], path)
    np.testing.assert_array_equal(read_runs(path)[0].pose, pose)


def test_columns_have_units_and_descriptions(stored):
    schema = pyarrow.parquet.read_schema(stored)
    assert set(schema.names) == set(COLUMNS) - OF_SAMPLES
    for field in schema:
        column = COLUMNS[field.name]
        assert field.metadata[b"unit"].decode() == column.unit
        assert field.metadata[b"description"].decode() == column.description
        assert (column.unit == NO_UNIT) == (field.name in ("run", "valid"))
        assert column.unit != PURE or pa.types.is_floating(field.type) or pa.types.is_integer(field.type)
    assert DOCS.read_text(encoding="utf-8").count(f"\n{markdown(COLUMNS.values())}\n") == 1


def test_runs_of_several_files_are_joined_under_new_names(stored, tmp_path, full):
    write_parquet([full, replace(full, run="s", scans=None)], tmp_path / "other.parquet")
    joined = tmp_path / "joined.parquet"
    join_parquet([(stored, "a", "r"), (tmp_path / "other.parquet", "s", "t")], joined)
    schema = pyarrow.parquet.read_schema(joined)
    about = json.loads(schema.metadata[b"trackslip"])
    assert [*about["runs"]] == ["r", "t"]
    assert schema.field("ranges").metadata[b"unit"] == b"m"
    first, second = trackslip.load(joined)
    assert (first.run, second.run) == ("r", "t")
    assert (first.scans is None, second.scans is None) == (False, True)
    alone = StoredRuns(joined).log("t")
    assert_same(alone, second)
    assert alone.metadata == full.metadata


def test_loading_takes_folders_and_files(stored, tmp_path, full):
    write_csv([full], tmp_path / "runs.csv")
    for path in (tmp_path, str(tmp_path), stored, tmp_path / "runs.csv"):
        (log,) = trackslip.load(path)
        np.testing.assert_array_equal(log.pose, full.pose)
    assert_same(runs_from_table(to_table([full]), "memory").runs[0], full)


def test_pandas_and_polars_read_it(stored, full):
    pandas, polars = pytest.importorskip("pandas"), pytest.importorskip("polars")
    np.testing.assert_array_equal(pandas.read_parquet(stored)[["x", "y", "phi"]].to_numpy(), full.pose)
    np.testing.assert_array_equal(polars.read_parquet(stored).select("x", "y", "phi").to_numpy(), full.pose)
    assert json.loads(polars.read_parquet_metadata(stored)["trackslip"])["runs"] == {"a": ANY}


def test_a_real_robots_log_needs_seven_columns(tmp_path):
    path = tmp_path / "real.csv"
    path.write_text(HEADER + "".join(LINES) + "b,5,1,1,0,0,0\nb,6,1,1,1,0,0\n")
    first, second = read_runs(path)
    assert (first.run, second.run) == ("a", "b")
    np.testing.assert_allclose(first.pose[:, 0], [0, 0.1, 0.2])
    assert first.truth is None
    assert first.is_valid.all()


def test_wrapped_headings_are_unwrapped(tmp_path):
    heading = 0.2 * np.arange(60) + 1.0
    pose = np.column_stack([np.zeros((60, 2)), heading])
    pose[20:25] = np.nan
    wrapped = pose.copy()
    wrapped[:, 2] = (wrapped[:, 2] + np.pi) % (2 * np.pi) - np.pi
    valid = np.isfinite(pose[:, 2])
    write_csv([RunLog("r", np.arange(60) * 0.1, np.ones((60, 2)), wrapped, valid=valid)], tmp_path / "wrapped.csv")
    np.testing.assert_allclose(read_runs(tmp_path / "wrapped.csv")[0].pose[:, 2], pose[:, 2])


@pytest.mark.parametrize(("duration", "count"), [(65.0, 10), (68.0, 10), (9.9, 2), (9.7, 1), (2.0, 1)])
def test_a_long_run_is_cut_into_parts_of_equal_duration(duration, count):
    time = 3.0 + np.arange(round(duration / 0.1) + 1) * 0.1
    whole = RunLog("drive", time, np.ones((len(time), 2)), np.zeros((len(time), 3)), gyro=time)
    parts = whole.cut(6.5)
    assert len({part.run for part in parts}) == len(parts) == count
    np.testing.assert_array_equal(np.concatenate([part.time for part in parts]), time)
    np.testing.assert_array_equal(np.concatenate([part.gyro for part in parts]), time)
    assert np.ptp([part.time[-1] - part.time[0] for part in parts]) < 0.21


# What cannot be read


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("run,t,omega_l,omega_r,x,phi\n", "column y is missing"),
        (HEADER, "no rows"),
        (HEADER.replace("phi", "phi,valid"), "no rows"),
        ("", "Empty CSV file"),
        (HEADER + LINES[0] + "a,1,1,2,oops,0,0\na,2,1,2,oops,0,0\n", "row 2, column x: 'oops' .*; so are 2 of its 3"),
        (HEADER + LINES[0] + "a,0.1,1,inf,0,0,0\n", "run 'a': 1 row"),
        (HEADER + LINES[0] + "a,0.1,1,2\n", "Expected 7 columns, got 4"),
        (HEADER + LINES[0], "run 'a': 1 row"),
        (HEADER + 3 * LINES[0], "row 2, column t: 0 is not after 0, the time before it; so are 2 of its 3 rows"),
        (HEADER + 2 * ",0.1,1,2,0,0,0\n", "2 rows left out: row 1, column run: empty"),
        (HEADER + "a,0,,2,0,0,0\na,1,1,,0,0,0\n", "run 'a': columns omega_l, omega_r: no row has both"),
        (HEADER[:-1] + ",x\n" + LINES[0][:-1] + ",1\n", "column x is there 2 times"),
    ],
)
def test_malformed_logs_are_named_by_row_and_column(tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(LogError, match=message) as caught:
        read_runs(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("column", "values"),
    [
        ("t", pa.array([0, 1, 2], pa.timestamp("ns"))),
        ("x", pa.array([[0.0], [1.0], [2.0]])),
        ("x", pa.array([True, False, True])),
        ("run", pa.array([[1], [1], [1]])),
        ("valid", pa.array([[1], [1], [1]])),
    ],
)
def test_odd_columns_are_named(column, values):
    columns = {"run": ["a"] * 3, "t": [0.0, 1.0, 2.0]} | {name: [0.0] * 3 for name in HEADER.strip().split(",")[2:]}
    with pytest.raises(LogError, match=f"column {column}"):
        runs_from_table(pa.table(columns | {column: values}), "odd")


@pytest.mark.parametrize("damage", [b"{", b"[]", b'{"runs": [1]}', b'{"runs": {"a": 1}}'])
def test_damaged_metadata_is_named(full, damage):
    with pytest.raises(LogError, match="odd: its metadata is damaged"):
        runs_from_table(to_table([full]).replace_schema_metadata({b"trackslip": damage}), "odd")


@pytest.mark.parametrize(("name", "value"), [("beams", "many"), ("mount", "there")])
def test_descriptions_of_scanners_that_are_none_are_refused(full, name, value):
    table = to_table([full])
    about = json.loads(table.schema.metadata[b"trackslip"])
    about["runs"]["a"]["scanned"] |= {name: value}
    with pytest.raises(LogError, match="run 'a': its scans are not as trackslip writes them"):
        runs_from_table(table.replace_schema_metadata({b"trackslip": json.dumps(about)}), "memory")


def damaged(good):
    """What may become of a file, by name."""
    middle = len(good) // 2
    return {
        "truncated": good[:middle],
        "end only": good[middle:],
        "a byte short": good[:-1],
        "random": np.random.default_rng(0).bytes(5000),
        "empty": b"",
        "a block overwritten": good[:middle] + bytes(64) + good[middle + 64 :],
    }


@pytest.mark.parametrize("what", damaged(b"PAR1" * 9))
def test_damaged_files_are_refused_in_one_line(stored, what):
    stored.write_bytes(damaged(stored.read_bytes())[what])
    for path in (stored, stored.parent):
        with pytest.raises(LogError) as caught:
            trackslip.load(path)
        assert str(stored) in str(caught.value)
        assert "\n" not in str(caught.value)


def test_files_that_are_no_logs(tmp_path, full):
    (tmp_path / "x.txt").write_text("")
    for path, message in (
        (tmp_path / "none", "no such file"),
        (tmp_path / "none.csv", "no such file"),
        (tmp_path / "x.txt", "must end in"),
        (tmp_path, r"there is no runs\.parquet in this folder"),
    ):
        with pytest.raises(LogError, match=message):
            trackslip.load(path)
    with pytest.raises(LogError, match="run 'a': there are 2 of it"):
        write_parquet([full, full], tmp_path / "a.parquet")
