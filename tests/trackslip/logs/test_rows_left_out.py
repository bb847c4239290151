"""Logs with damage: only what is damaged is left out, and said so."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

import trackslip
from trackslip.logs.checks import in_order, restarts
from trackslip.logs.logfile import read_log

HEADER = "run,t,omega_l,omega_r,x,y,phi,valid\n"


def lines(run="a", rows=10, start=0.0):
    return [f"{run},{start + 0.1 * k:.1f},1,{2 + k},{0.1 * k:.1f},0,0,true\n" for k in range(rows)]


def read(path, rows, header=HEADER):
    file = path / "log.csv"
    file.write_text(header + "".join(rows))
    return read_log(file)


def changed(row, column, value):
    cells = row.rstrip("\n").split(",")
    cells[HEADER.rstrip("\n").split(",").index(column)] = value
    return ",".join(cells) + "\n"


@pytest.mark.parametrize("value", ["inf", "oops", "-inf", "1e300", "1_0_"])
@pytest.mark.parametrize("column", ["omega_l", "omega_r", "t"])
def test_a_row_with_a_damaged_reading_or_time_is_left_out(tmp_path, column, value):
    rows = lines()
    rows[4] = changed(rows[4], column, value)
    (run,), notes = (found := read(tmp_path, rows)).runs, found.notes
    np.testing.assert_allclose(run.time, np.delete(np.arange(10) / 10, 4))
    assert run.omega[:, 1].tolist() == [2, 3, 4, 5, 7, 8, 9, 10, 11]
    assert notes == (f"run 'a': 1 row left out: row 5, column {column}: {value!r} is not a finite number",)


@pytest.mark.parametrize("value", ["inf", "oops", "1e300"])
def test_a_damaged_position_is_a_pose_left_out(tmp_path, value):
    rows = lines()
    for k in (4, 6):
        rows[k] = changed(rows[k], "y", value)
    (run,), notes = (found := read(tmp_path, rows)).runs, found.notes
    assert len(run.time) == 10
    assert np.flatnonzero(~run.is_valid).tolist() == [4, 6]
    assert notes == (f"run 'a': 2 poses left out: row 5, column y: {value!r} is not a finite number",)


def test_an_odd_validity_is_a_pose_left_out(tmp_path):
    rows = lines()
    rows[4] = changed(rows[4], "valid", "perhaps")
    (run,), notes = (found := read(tmp_path, rows)).runs, found.notes
    assert np.flatnonzero(~run.is_valid).tolist() == [4]
    assert notes == ("run 'a': 1 pose left out: row 5, column valid: 'perhaps' is not true or false",)


def test_poses_that_are_said_not_to_be_valid_may_hold_anything(tmp_path):
    rows = lines()
    rows[4] = "a,0.4,1,6,nan,oops,inf,false\n"
    found = read(tmp_path, rows)
    assert found.warnings == ()
    assert np.flatnonzero(~found.runs[0].is_valid).tolist() == [4]


def test_nan_is_an_empty_cell(tmp_path):
    rows = lines()
    rows[2] = changed(rows[2], "omega_l", "nan")
    rows[4] = "a,0.4,1,6,nan,NaN,nan,true\n"
    found = read(tmp_path, rows)
    assert found.warnings == ()
    assert found.runs[0].omega[2:4, 1].tolist() == [5, 5]
    assert np.flatnonzero(~found.runs[0].is_valid).tolist() == [4]


def test_an_empty_pose_was_not_measured(tmp_path):
    rows = lines()
    rows[4] = "a,0.4,1,6,,,,\n"
    rows[5] = "a,0.5,1,7,0.5,0,,true\n"
    found = read(tmp_path, rows)
    (run,) = found.runs
    assert found.warnings == ()
    assert np.flatnonzero(~run.is_valid).tolist() == [4]
    assert np.flatnonzero(~run.has_heading).tolist() == [4, 5]


def test_a_log_without_headings(tmp_path):
    (run,) = read(tmp_path, [f"a,{k},1,2,{k},0\n" for k in range(5)], "run,t,omega_l,omega_r,x,y\n").runs
    assert run.is_valid.all()
    assert not run.has_heading.any()


def test_rows_without_encoder_take_the_reading_that_covers_them(tmp_path):
    rows = lines()
    rows[2] = changed(changed(rows[2], "omega_l", ""), "omega_r", "")
    rows[3] = changed(rows[3], "omega_r", "")
    rows[9] = changed(rows[9], "omega_l", "")
    found = read(tmp_path, rows)
    assert found.runs[0].omega[:, 1].tolist() == [2, 3, 6, 6, 6, 7, 8, 9, 10]
    assert found.notes == ("run 'a': 1 row after its last encoder reading left out",)


@pytest.mark.parametrize(
    ("stamps", "kept", "note"),
    [
        ([0, 1, 1, 2, 3], [0, 1, 3, 4], "row 3, column t: 1 is not after 1, the time before it"),
        ([0, 1, 2, 1.5, 3], [0, 1, 3, 4], "row 4, column t: 1.5 is not after 2, the time before it"),
        ([0, 99, 1, 2, 3], [0, 2, 3, 4], "row 3, column t: 1 is not after 99, the time before it"),
        ([5, 0, 1, 2, 3], [1, 2, 3, 4], "row 2, column t: 0 is not after 5, the time before it"),
    ],
)
def test_a_time_out_of_order_leaves_out_as_few_rows_as_possible(tmp_path, stamps, kept, note):
    rows = [changed(row, "t", str(stamp)) for row, stamp in zip(lines(), stamps, strict=False)]
    found = read(tmp_path, rows)
    np.testing.assert_array_equal(found.runs[0].time, np.array(stamps, float)[kept])
    assert found.notes == (f"run 'a': 1 row left out: {note}",)


def test_as_many_rows_as_possible_stay():
    rng = np.random.default_rng(0)
    for _ in range(50):
        time = rng.integers(0, 12, 9).astype(float)
        chosen = in_order(time)
        assert (np.diff(time[chosen]) > 0).all()
        assert (np.diff(chosen) > 0).all()
        subsets = (np.flatnonzero([number >> k & 1 for k in range(9)]) for number in range(1, 512))
        assert len(chosen) == max(len(rows) for rows in subsets if (np.diff(time[rows]) > 0).all())


def test_two_drives_under_one_name_are_read_as_two_runs(tmp_path):
    found = read(tmp_path, lines(rows=30) + lines(rows=40))
    assert [(run.run, len(run.time)) for run in found.runs] == [("a, part 1", 30), ("a, part 2", 40)]
    assert found.notes == ("run 'a': row 31, column t: goes back from 2.9 s to 0 s: read as 2 runs",)


def test_restarts_are_found_where_they_are():
    time = np.concatenate([np.arange(100) * 0.05, np.arange(200) * 0.05, np.arange(50) * 0.05])
    time[[40, 150, 151]] += [1e9, -30, -30]  # wrong stamps are no restarts
    assert restarts(time).tolist() == [100, 300]


def test_a_run_most_of_whose_rows_are_damaged_is_refused(tmp_path):
    bad = [changed(row, "omega_l", "oops") for row in lines("bad")[:6]] + lines("bad")[6:]
    found = read(tmp_path, lines("good") + bad + lines("short", rows=1) + lines("", rows=2))
    assert [run.run for run in found.runs] == ["good"]
    assert [str(refused) for refused in found.refused] == [
        "run 'bad' left out: row 11, column omega_l: 'oops' is not a finite number; so are 6 of its 10 rows",
        "run 'short' left out: 1 row, needs at least 2",
    ]
    assert found.notes == ("2 rows left out: row 22, column run: empty",)


def test_what_is_left_out_warns_whoever_loads_it(tmp_path):
    rows = lines()
    rows[4] = changed(rows[4], "x", "oops")
    read(tmp_path, rows + lines("b", rows=1))
    with pytest.warns(trackslip.LogWarning) as caught:
        (run,) = trackslip.load(tmp_path / "log.csv")
    assert run.run == "a"
    assert [str(warning.message) for warning in caught] == [
        f"{tmp_path / 'log.csv'}: run 'a': 1 pose left out: row 5, column x: 'oops' is not a finite number",
        f"{tmp_path / 'log.csv'}: run 'b' left out: 1 row, needs at least 2",
    ]
    assert caught[0].filename == __file__


def test_parquet_null_and_nan_are_poses_that_were_not_measured(tmp_path):
    columns = {"run": ["a"] * 10, "t": np.arange(10.0)} | {name: np.ones(10) for name in ("omega_l", "omega_r", "y")}
    x = [0.0, None, *map(float, range(2, 10))]
    for value in (None, np.nan):
        x[1] = value
        pyarrow.parquet.write_table(pa.table(columns | {"x": pa.array(x)}), tmp_path / "log.parquet")
        found = read_log(tmp_path / "log.parquet")
        assert np.flatnonzero(~found.runs[0].is_valid).tolist() == [1]
        assert found.notes == ()


@pytest.mark.parametrize("text", ["+1.5", " 1.5 ", "1.5e0", "15e-1", "1.50", "1_5e-1"])
def test_numbers_in_text_are_read_as_python_reads_them(tmp_path, text):
    rows = lines()
    rows[4] = changed(rows[4], "y", text)
    assert read(tmp_path, rows).runs[0].pose[4, 1] == 1.5


def test_rows_of_one_time_that_complement_each_other_are_one(tmp_path):
    """Encoder and poses in rows of their own, sorted by time, as from two topics of a bag."""
    rows = []
    for k in range(100):
        encoder, pose = f"a,{k / 50},{k},{2 * k},,,,\n", f"a,{k / 50},,,{k},{-k},0.1,true\n"
        rows += ([encoder, pose] if k % 20 else [pose, encoder]) if k % 5 == 0 else [encoder]
    found = read(tmp_path, rows)
    (run,) = found.runs
    assert found.warnings == ()
    np.testing.assert_array_equal(run.time, np.arange(100) / 50)
    np.testing.assert_array_equal(run.omega, np.arange(100)[:, None] * [1, 2])
    np.testing.assert_array_equal(np.flatnonzero(run.is_valid), np.arange(0, 100, 5))
    np.testing.assert_array_equal(run.pose[run.is_valid, 0], np.arange(0, 100, 5))
