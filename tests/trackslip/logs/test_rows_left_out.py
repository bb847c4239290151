import numpy as np
import pytest

from trackslip.logs.checks import in_order
from trackslip.logs.logfile import read_log

HEADER = "run,t,omega_l,omega_r,x,y,phi,valid\n"


def lines(run="a", rows=10, start=0.0):
    made = []
    for k in range(rows):
        time = start + 0.1 * k
        made.append(f"{run},{time:.1f},1,{2 + k},{0.1 * k:.1f},0,0,true\n")
    return made


def read(path, rows, header=HEADER):
    file = path / "log.csv"
    file.write_text(header + "".join(rows))
    return read_log(file)


def changed(row, column, value):
    cells = row.rstrip("\n").split(",")
    names = HEADER.rstrip("\n").split(",")
    cells[names.index(column)] = value
    return ",".join(cells) + "\n"


@pytest.mark.parametrize("value", ["inf", "oops", "1e300"])
@pytest.mark.parametrize("column", ["omega_l", "omega_r", "t"])
def test_a_row_with_a_damaged_reading_or_time_is_left_out(tmp_path, column, value):
    rows = lines()
    rows[4] = changed(rows[4], column, value)
    (run,) = (found := read(tmp_path, rows)).runs
    np.testing.assert_allclose(run.time, np.delete(np.arange(10) / 10, 4))
    assert run.omega[:, 1].tolist() == [2, 3, 4, 5, 7, 8, 9, 10, 11]
    (note,) = found.notes
    reason = f"row 5, column {column}: {value!r} is not a finite number"
    assert note == f"run 'a': 1 row left out: {reason}"


@pytest.mark.parametrize(
    ("changes", "unknown", "note"),
    [
        (
            {4: "a,0.4,1,6,0.4,inf,0,true", 6: "a,0.6,1,8,0.6,oops,0,true"},
            [4, 6],
            "2 poses left out: row 5, column y: 'inf' is not a finite number",
        ),
        (
            {4: "a,0.4,1,6,1e300,0,0,true"},
            [4],
            "1 pose left out: row 5, column x: '1e300' is not a finite number",
        ),
        (
            {4: "a,0.4,1,6,0.4,0,0,perhaps"},
            [4],
            "1 pose left out: row 5, column valid: 'perhaps' is not true or false",
        ),
        ({4: "a,0.4,1,6,nan,oops,inf,false"}, [4], None),
        ({4: "a,0.4,1,6,,,,"}, [4], None),
        ({5: "a,0.5,1,7,0.5,0,,true"}, [], None),
    ],
)
def test_poses_that_are_damaged_or_missing_are_left_out(tmp_path, changes, unknown, note):
    rows = lines()
    for row, line in changes.items():
        rows[row] = line + "\n"
    (run,) = (found := read(tmp_path, rows)).runs
    assert len(run.time) == 10
    assert np.flatnonzero(~run.is_valid).tolist() == unknown
    notes = (f"run 'a': {note}",) if note else ()
    assert found.notes == notes
    assert run.has_heading.sum() == 9 - (len(changes) > 1)


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
        (
            [0, 1, 2, 1.5, 3],
            [0, 1, 3, 4],
            "row 4, column t: 1.5 is not after 2, the time before it",
        ),
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
    for _ in range(20):
        time = rng.integers(0, 12, 8).astype(float)
        chosen = in_order(time)
        assert (np.diff(time[chosen]) > 0).all()
        assert (np.diff(chosen) > 0).all()
        subsets = (np.flatnonzero([number >> k & 1 for k in range(8)]) for number in range(1, 256))
        longest = max(len(rows) for rows in subsets if (np.diff(time[rows]) > 0).all())
        assert len(chosen) == longest


def test_two_drives_under_one_name_are_read_as_two_runs(tmp_path):
    first = lines(rows=30)
    second = lines(rows=40)
    found = read(tmp_path, first + second)
    rows = {run.run: len(run.time) for run in found.runs}
    assert rows == {"a, part 1": 30, "a, part 2": 40}
    assert found.notes == (
        "run 'a': row 31, column t: goes back from 2.9 s to 0 s: read as 2 runs",
    )


def test_a_run_most_of_whose_rows_are_damaged_is_refused(tmp_path):
    good = lines("good")
    mostly_bad = lines("bad")
    for k in range(6):
        mostly_bad[k] = changed(mostly_bad[k], "omega_l", "oops")
    short = lines("short", rows=1)
    nameless = lines("", rows=2)
    found = read(tmp_path, good + mostly_bad + short + nameless)
    assert [run.run for run in found.runs] == ["good"]
    damaged = "row 11, column omega_l: 'oops' is not a finite number; so are 6 of its 10 rows"
    assert [str(refused) for refused in found.refused] == [
        f"run 'bad' left out: {damaged}",
        "run 'short' left out: 1 row, needs at least 2",
    ]
    assert found.notes == ("2 rows left out: row 22, column run: empty",)
