import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from full_log import full_log
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from trackslip.errors import LogError
from trackslip.logs.logfile import join_parquet, read_runs, write_csv, write_parquet
from trackslip.logs.runlog import RunLog, Truth
from trackslip.logs.table import to_table
from trackslip.logs.table_reader import runs_from_table

HEADER = "run,t,omega_l,omega_r,x,y,phi\n"
LINES = ["a,0.0,1,2,0,0,0\n", "a,0.1,1,2,0.1,0,0\n", "a,0.2,1,2,0.2,0,0\n"]


def make_log(name, rows=5, seed=0, truth=True):
    rng = np.random.default_rng(seed)
    valid = rng.random(rows) > 0.2
    half = rng.normal(size=(rows, 3, 3))
    return RunLog(
        run=name,
        time=np.cumsum(rng.uniform(0.01, 0.1, rows)),
        omega=rng.normal(size=(rows, 2)),
        pose=np.cumsum(rng.uniform(-0.5, 0.5, size=(rows, 3)), axis=0),
        command=rng.normal(size=(rows, 2)),
        covariance=half @ half.swapaxes(1, 2),
        valid=valid,
        truth=Truth(*(rng.normal(size=(rows, n)) for n in (3, 3, 2, 2))) if truth else None,
        metadata={"seed": seed, "geometry": {"half_gauge": 0.168}},
    )


def assert_same(a, b):
    assert a.run == b.run
    for name in ("time", "omega", "pose", "command", "covariance", "valid", "twist_command"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert (a.truth is None) == (b.truth is None)
    if a.truth is not None and b.truth is not None:
        for name in ("pose", "twist", "traction", "torque"):
            np.testing.assert_array_equal(getattr(a.truth, name), getattr(b.truth, name))


@pytest.mark.parametrize(("suffix", "write"), [("csv", write_csv), ("parquet", write_parquet)])
def test_round_trip_is_exact(tmp_path, suffix, write):
    logs = [make_log("a"), make_log("b", rows=9, seed=1), make_log("c", seed=2, truth=False)]
    write(logs, tmp_path / f"runs.{suffix}")
    back = read_runs(tmp_path / f"runs.{suffix}")
    for before, after in zip(logs, back, strict=True):
        assert_same(before, after)
    assert [log.metadata for log in back] == ([log.metadata for log in logs] if suffix == "parquet" else [{}] * 3)


@pytest.mark.parametrize(("suffix", "write"), [("csv", write_csv), ("parquet", write_parquet)])
def test_runs_with_and_without_validity_and_covariance_go_together(tmp_path, suffix, write):
    logs = [make_log("a"), replace(make_log("b"), valid=None), replace(make_log("c"), covariance=None)]
    write(logs, tmp_path / f"runs.{suffix}")
    for before, after in zip(logs, read_runs(tmp_path / f"runs.{suffix}"), strict=True):
        np.testing.assert_array_equal(after.is_valid, before.is_valid)
        assert (after.covariance is None) == (before.covariance is None)
        if before.covariance is not None:
            np.testing.assert_array_equal(after.covariance, before.covariance)


def test_runs_with_other_columns_may_come_between_alike_ones():
    logs = [make_log("a"), replace(make_log("b"), covariance=None), make_log("c", rows=7, seed=1)]
    logs += [replace(make_log("d"), valid=None), make_log("e", seed=2)]
    together = to_table(logs).combine_chunks()
    apart = pa.concat_tables([to_table([log]) for log in logs], promote_options="default")
    assert together.equals(apart.combine_chunks())


@given(arrays(float, (2, 2), elements=st.floats(-1e21, 1e21)), st.floats(-1, 1))
def test_csv_keeps_every_bit(tmp_path_factory, position, heading):
    pose = np.column_stack([position, [heading, -heading]])
    path = tmp_path_factory.mktemp("csv") / "run.csv"
    write_csv([RunLog("r", np.array([0.0, 1.0]), np.ones((2, 2)), pose)], path)
    np.testing.assert_array_equal(read_runs(path)[0].pose, pose)


def test_columns_carry_their_units(tmp_path):
    write_parquet([make_log("a")], tmp_path / "a.parquet")
    schema = pyarrow.parquet.read_schema(tmp_path / "a.parquet")
    units = {f.name: f.metadata[b"unit"].decode() for f in schema if f.metadata and b"unit" in f.metadata}
    assert units["x"] == "m"
    assert units["omega_l"] == "rad/s"
    assert set(schema.names) == set(units)


def test_a_real_robots_log_needs_seven_columns(tmp_path):
    path = tmp_path / "real.csv"
    path.write_text(HEADER + "".join(LINES) + "b,5,1,1,0,0,0\nb,6,1,1,1,0,0\n")
    first, second = read_runs(path)
    assert first.run == "a"
    assert second.run == "b"
    np.testing.assert_allclose(first.pose[:, 0], [0, 0.1, 0.2])
    assert first.truth is None
    assert first.is_valid.all()


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
    ],
)
def test_malformed_logs_are_named_by_row_and_column(tmp_path: Path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(LogError, match=message) as caught:
        read_runs(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_poses_that_were_not_measured_may_be_missing(tmp_path):
    path = tmp_path / "gap.csv"
    path.write_text(
        HEADER[:-1] + ",valid\n" + "a,0,1,2,0,0,0,true\na,0.1,1,2,nan,nan,nan,false\na,0.2,1,2,0,0,0,true\n"
    )
    log = read_runs(path)[0]
    assert log.valid is not None
    assert log.valid.tolist() == [True, False, True]


def test_wrapped_headings_are_unwrapped(tmp_path):
    heading = 0.2 * np.arange(60) + 1.0
    pose = np.column_stack([np.zeros((60, 2)), heading])
    pose[20:25] = np.nan
    wrapped = pose.copy()
    wrapped[:, 2] = (wrapped[:, 2] + np.pi) % (2 * np.pi) - np.pi
    valid = np.isfinite(pose[:, 2])
    write_csv([RunLog("r", np.arange(60) * 0.1, np.ones((60, 2)), wrapped, valid=valid)], tmp_path / "wrapped.csv")
    np.testing.assert_allclose(read_runs(tmp_path / "wrapped.csv")[0].pose[:, 2], pose[:, 2])


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
def test_odd_columns_are_named(tmp_path, column, values):
    columns = {"run": ["a"] * 3, "t": [0.0, 1.0, 2.0]} | dict.fromkeys(
        ("omega_l", "omega_r", "x", "y", "phi"), [0.0] * 3
    )
    pyarrow.parquet.write_table(pa.table(columns | {column: values}), tmp_path / "odd.parquet")
    with pytest.raises(LogError, match=f"column {column}"):
        read_runs(tmp_path / "odd.parquet")


def test_damaged_files(tmp_path):
    (tmp_path / "twice.csv").write_text(HEADER[:-1] + ",x\n" + LINES[0][:-1] + ",1\n")
    with pytest.raises(LogError, match="column x is there 2 times"):
        read_runs(tmp_path / "twice.csv")
    for damage in (b"{", b"[]", b'{"runs": [1]}', b'{"runs": {"a": 1}}'):
        table = to_table([make_log("a")]).replace_schema_metadata({b"trackslip": damage})
        pyarrow.parquet.write_table(table, tmp_path / "damaged.parquet")
        with pytest.raises(LogError, match="damaged"):
            read_runs(tmp_path / "damaged.parquet")


@pytest.mark.parametrize(("name", "value"), [("beams", "many"), ("mount", "there")])
def test_descriptions_of_scanners_that_are_none_are_refused(name, value):
    table = to_table([full_log()])
    about = json.loads(table.schema.metadata[b"trackslip"])
    about["runs"]["a run"]["scanned"] |= {name: value}
    with pytest.raises(LogError, match="run 'a run': invalid description of its scanner"):
        runs_from_table(table.replace_schema_metadata({b"trackslip": json.dumps(about)}), "memory")


def test_two_runs_of_one_name_are_not_written(tmp_path):
    with pytest.raises(LogError, match="run 'a': there are 2 of it"):
        write_parquet([make_log("a"), make_log("a")], tmp_path / "a.parquet")


def test_files_that_are_no_logs(tmp_path):
    with pytest.raises(LogError, match="no such file"):
        read_runs(tmp_path / "none.csv")
    (tmp_path / "x.txt").write_text("")
    with pytest.raises(LogError, match="must end in"):
        read_runs(tmp_path / "x.txt")


def test_a_table_in_memory_is_read_as_well():
    assert_same(runs_from_table(to_table([make_log("a")]), "memory").runs[0], make_log("a"))


def test_damage_to_what_is_remembered_of_runs_is_noticed(tmp_path):
    """It stands in the footer, of which Parquet has no checksum."""
    path = tmp_path / "runs.parquet"
    write_parquet([make_log("a")], path)
    footer = pa.parquet.read_metadata(path).metadata
    assert footer[b"trackslip"].count(b"0.168") == 1
    table = pa.parquet.read_table(path)
    changed = {**table.schema.metadata, b"trackslip": footer[b"trackslip"].replace(b"0.168", b"0.178")}
    pa.parquet.write_table(table.replace_schema_metadata(changed), path)
    with pytest.raises(LogError, match=r"runs.parquet: its metadata is damaged \(its checksum is wrong\)"):
        read_runs(path)
    with pytest.raises(LogError, match="its checksum is wrong"):
        join_parquet([(path, "a", "a")], tmp_path / "joined.parquet")
