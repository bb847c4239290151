import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from full_log import full_log

import trackslip
from trackslip.errors import LogError
from trackslip.logs.logfile import RUNS, join_parquet, read_runs, write_csv, write_parquet
from trackslip.logs.runlog import RunLog
from trackslip.logs.schema import COLUMNS, NO_UNIT, PURE

DOCS = Path(__file__).parents[3] / "docs" / "data.md"
OF_SAMPLES = {"v", "w", "slip_l", "slip_r"}
HEADER = "run,t,omega_l,omega_r,x,y,phi\n"
LINES = ["a,0.0,1,2,0,0,0\n", "a,0.1,1,2,0.1,0,0\n", "a,0.2,1,2,0.2,0,0\n"]
WRITERS = [("runs.csv", write_csv), ("runs.parquet", write_parquet)]


@pytest.fixture(scope="module")
def full():
    return full_log()


@pytest.fixture
def stored(full, tmp_path):
    write_parquet([full], tmp_path / RUNS)
    return tmp_path / RUNS


def assert_same(read, written):
    for name in (
        "run",
        "time",
        "omega",
        "pose",
        "command",
        "twist_command",
        "icr",
        "covariance",
        "valid",
        "load",
    ):
        np.testing.assert_array_equal(getattr(read, name), getattr(written, name))
    assert (read.truth is None) == (written.truth is None)
    if written.truth is not None:
        for name in ("pose", "twist", "traction", "torque", "power", "saturated", "lean"):
            np.testing.assert_array_equal(getattr(read.truth, name), getattr(written.truth, name))


@pytest.mark.parametrize(("name", "write"), WRITERS)
def test_round_trip_is_exact_whatever_the_runs_have(tmp_path, full, name, write):
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


def test_columns_have_units_and_descriptions(stored):
    schema = pyarrow.parquet.read_schema(stored)
    assert set(schema.names) == set(COLUMNS) - OF_SAMPLES - {"gyro"}
    for field in schema:
        column = COLUMNS[field.name]
        assert field.metadata[b"unit"].decode() == column.unit
        assert field.metadata[b"description"].decode() == column.description
        assert (column.unit == NO_UNIT) == (field.name in ("run", "valid"))
        is_number = pa.types.is_floating(field.type) or pa.types.is_integer(field.type)
        assert is_number or column.unit != PURE
    rows = [
        f"| `{column.name}` | {column.unit or '–'} | {column.description} |"
        for column in COLUMNS.values()
    ]
    assert "\n".join(rows) in DOCS.read_text(encoding="utf-8")


def test_runs_of_several_files_are_joined_under_new_names(stored, tmp_path, full):
    write_parquet([full, replace(full, run="s", scans=None)], tmp_path / "other.parquet")
    joined = tmp_path / "joined.parquet"
    join_parquet([(stored, "a", "r"), (tmp_path / "other.parquet", "s", "t")], joined)
    schema = pyarrow.parquet.read_schema(joined)
    about = json.loads(schema.metadata[b"trackslip"])
    assert [*about["runs"]] == ["r", "t"]
    assert schema.field("ranges").metadata[b"unit"] == b"m"
    first, second = trackslip.load(joined)
    assert first.run == "r"
    assert second.run == "t"
    assert first.scans is not None
    assert second.scans is None
    assert second.metadata == full.metadata


@pytest.mark.parametrize(
    ("duration", "count"), [(65.0, 10), (68.0, 10), (9.9, 2), (9.7, 1), (2.0, 1)]
)
def test_a_long_run_is_cut_into_parts_of_equal_duration(duration, count):
    time = 3.0 + np.arange(round(duration / 0.1) + 1) * 0.1
    whole = RunLog("drive", time, np.ones((len(time), 2)), np.zeros((len(time), 3)), gyro=time)
    parts = whole.cut(6.5)
    names = {part.run for part in parts}
    assert len(names) == len(parts) == count
    np.testing.assert_array_equal(np.concatenate([part.time for part in parts]), time)
    np.testing.assert_array_equal(np.concatenate([part.gyro for part in parts]), time)
    durations = [part.time[-1] - part.time[0] for part in parts]
    assert np.ptp(durations) < 0.21


# What cannot be read


@pytest.mark.parametrize(
    ("column", "cell", "said"),
    [
        ("first_beam", None, "its scans need numbers in first_beam, lost, hidden_first, hidden_la"),
        ("lost", np.inf, "its scans need numbers in first_beam, lost, hidden_first, hidden_last"),
        ("hidden_last", None, "its scans need numbers in first_beam, lost, hidden_first, hidden_l"),
        ("ranges", None, "its scans have empty cells in ranges"),
        ("ranges", [1.0] * 31, "its scans have beams beyond the scanner's 31"),
        ("first_beam", -1, "its scans have beams beyond the scanner's 31"),
    ],
)
def test_an_impossible_cell_of_a_scan_is_one_line(stored, column, cell, said):
    table = pyarrow.parquet.read_table(stored)
    cells = table[column].to_pylist()
    cells[3] = cell
    kind = pa.float64() if cell == np.inf else table.schema.field(column).type
    place = table.column_names.index(column)
    damaged = table.set_column(place, column, pa.array(cells, kind))
    pyarrow.parquet.write_table(damaged, stored)
    with pytest.raises(LogError, match=said) as refused:
        read_runs(stored)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("run,t,omega_l,omega_r,x,phi\n", "has no column y"),
        (HEADER, "no rows"),
        ("", "Empty CSV file"),
        (
            HEADER + LINES[0] + "a,1,1,2,oops,0,0\na,2,1,2,oops,0,0\n",
            "row 2, column x: 'oops' .*; so are 2 of its 3",
        ),
        (HEADER + LINES[0] + "a,0.1,1,inf,0,0,0\n", "run 'a': 1 row"),
        (HEADER + LINES[0] + "a,0.1,1,2\n", "Expected 7 columns, got 4"),
        (
            HEADER + LINES[0] + "a,0,1,3,0,0,0\na,0,1,4,0,0,0\n",
            "row 2, .* 0 is not after 0, .*; so are 2 of its 3",
        ),
        (HEADER + 2 * ",0.1,1,2,0,0,0\n", "2 rows left out: row 1, column run: empty"),
        (
            HEADER + "a,0,,2,0,0,0\na,1,1,,0,0,0\n",
            "run 'a': columns omega_l, omega_r: no row has both",
        ),
        (HEADER[:-1] + ",x\n" + LINES[0][:-1] + ",1\n", "column x is there 2 times"),
    ],
)
def test_malformed_logs_are_named_by_row_and_column(tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(LogError, match=message) as caught:
        read_runs(path)
    assert str(path) in str(caught.value)


def damaged(good):
    middle = len(good) // 2
    return {
        "truncated": good[:middle],
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
