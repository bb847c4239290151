import dataclasses

import numpy as np
import pyarrow.parquet as pq
import pytest

from trackslip.errors import LogError, OutputError
from trackslip.logs.logfile import StoredRuns, join_parquet, read_runs, read_table, write_parquet
from trackslip.logs.run_writer import RunWriter
from trackslip.logs.runlog import RunLog, Truth


def run(name, rows=10):
    time = 0.1 * np.arange(rows)
    pose = np.column_stack([time, 2 * time, 0.1 * time])
    truth = Truth(pose=pose + 0.01, twist=pose, contact=np.ones((rows, 2, 3)))
    return RunLog(name, time, pose[:, :2] + 1, pose, truth=truth, metadata={"name": name})


def parts(logs, ends):
    return [[log.between(a, b) for log in logs] for a, b in zip((0, *ends), (*ends, len(logs[0].time)), strict=True)]


def write(path, pieces):
    with RunWriter(path) as file:
        for piece in pieces:
            file.write(piece)


def test_parts_make_the_same_runs_as_the_whole(tmp_path):
    logs = [run("one"), run("two")]
    write_parquet(logs, tmp_path / "whole.parquet")
    write(tmp_path / "parts.parquet", parts(logs, (4, 7)))
    whole = read_table(tmp_path / "whole.parquet")
    pieces = StoredRuns(tmp_path / "parts.parquet")
    assert read_table(tmp_path / "parts.parquet").schema.equals(whole.schema, check_metadata=True)
    for k, log in enumerate(logs):
        assert pieces.table(log.run, log.run).equals(whole.slice(10 * k, 10).replace_schema_metadata(None))
        assert pieces.log(log.run).metadata == log.metadata
    for mine, theirs in zip(read_runs(tmp_path / "parts.parquet"), logs, strict=True):
        np.testing.assert_array_equal(mine.time, theirs.time)
        np.testing.assert_array_equal(mine.truth.contact, theirs.truth.contact)


def test_small_parts_share_row_groups_and_large_ones_are_split(tmp_path):
    log = run("one", 3000)
    write(tmp_path / "small.parquet", parts([log], range(30, 3000, 30)))
    assert pq.read_metadata(tmp_path / "small.parquet").num_row_groups == 1
    write(tmp_path / "large.parquet", [[run(f"{k}", 3000) for k in range(50)], [run(f"{k}", 3000) for k in range(50)]])
    groups = pq.read_metadata(tmp_path / "large.parquet")
    assert [groups.row_group(k).num_rows for k in range(groups.num_row_groups)] == [131_072, 18_928] * 2


def test_runs_in_parts_are_joined_with_others(tmp_path):
    write(tmp_path / "parts.parquet", parts([run("one"), run("two")], (5,)))
    join_parquet([(tmp_path / "parts.parquet", "two", "new")], tmp_path / "joined.parquet")
    (log,) = read_runs(tmp_path / "joined.parquet")
    assert (log.run, len(log.time)) == ("new", 10)


def test_an_interrupted_file_leaves_nothing_behind(tmp_path):
    path = tmp_path / "runs.parquet"
    path.write_text("before")
    with pytest.raises(LogError, match="part of the runs"):
        write(path, [[run("one")], [run("other")]])
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]
    with RunWriter(tmp_path / "empty.parquet"):
        pass
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("second", "message"),
    [
        ([run("other")], r"part of the runs \['other'\], where those before are of \['one'\]"),
        ([dataclasses.replace(run("one"), truth=None)], "columns .*, before"),
    ],
)
def test_a_part_of_something_else_is_refused(tmp_path, second, message):
    with pytest.raises(LogError, match=message):
        write(tmp_path / "runs.parquet", [[run("one")], second])
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there_is_one_clear_line(tmp_path):
    path = tmp_path / "nowhere" / "runs.parquet"
    with pytest.raises(OutputError, match="can't be written") as caught:
        write(path, [[run("one")]])
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
