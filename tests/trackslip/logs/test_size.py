"""Tables that would take more memory than is allowed are refused before the memory is taken."""

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from bombs import (
    LITTLE,
    NUMBERS,
    empty_rows,
    long_lists,
    read_with_little_memory,
    repeated_numbers,
    repeated_text,
    table,
)

import trackslip
from trackslip.errors import LogError
from trackslip.logs.logfile import join_parquet, read_table
from trackslip.logs.size import LONGEST_LINE, MOST_COLUMNS
from trackslip.logs.table import file_metadata
from trackslip.logs.table_reader import runs_from_table


def test_tables_are_refused_before_their_memory_is_taken(tmp_path):
    paths = [
        repeated_numbers(tmp_path / "numbers.parquet"),
        repeated_text(tmp_path / "text.parquet"),
        long_lists(tmp_path / "lists.parquet"),
        empty_rows(tmp_path / "rows.csv"),
    ]
    assert sum(path.stat().st_size for path in paths) < 2_000_000
    messages, taken = read_with_little_memory(*paths)
    assert taken < LITTLE
    for path, message in zip(paths, messages, strict=True):
        assert message.startswith(f"{path}: reading it may take ")
        assert message.endswith("of memory or more, must be at most 100 MB (max_memory)")


def test_a_table_that_fits_is_read(tmp_path):
    path = tmp_path / "log.parquet"
    pq.write_table(table(1000, run=pa.array(["a"] * 1000)), path)
    assert read_table(path, 1_000_000).num_rows == 1000
    with pytest.raises(LogError, match=r"log\.parquet: reading it may take \d+ KB of memory"):
        read_table(path, 300_000)


def test_texts_count_as_often_as_they_occur(tmp_path):
    path = tmp_path / "log.parquet"
    for rows in (10, 1000):
        text = pa.array(["long" * 1000] * rows)
        pq.write_table(table(rows, run=text), path, write_statistics=False)
        if rows == 10:
            assert read_table(path, 1_000_000).num_rows == rows
    with pytest.raises(LogError, match=r"reading it may take 12\.\d MB"):
        read_table(path, 1_000_000)


def test_texts_in_lists_count_as_their_longest(tmp_path):
    path = tmp_path / "log.parquet"
    lists = pa.array([["long" * 1000] * 1000])
    pq.write_table(table(1, lists=lists), path, write_statistics=False)
    with pytest.raises(LogError, match=r"reading it may take 1\d\.\d MB"):
        read_table(path, 1_000_000)


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_a_table_with_too_many_columns_is_refused(tmp_path, kind):
    names = [f"c{k}" for k in range(MOST_COLUMNS + 1)]
    path = tmp_path / f"log.{kind}"
    if kind == "csv":
        path.write_text(",".join(names) + "\n")
    else:
        pq.write_table(pa.table({name: [1.0] for name in names}), path)
    with pytest.raises(LogError, match=r"has 10001 columns, must have at most 10000$"):
        read_table(path)


def test_a_csv_line_that_is_too_long_is_refused(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(",".join(NUMBERS) + "\n" + LONGEST_LINE * "1" + "1\n")
    with pytest.raises(LogError, match=r"line 2 is longer than 1000000 characters$"):
        read_table(path)


def test_a_table_with_a_large_description_is_refused(tmp_path):
    path = tmp_path / "log.parquet"
    described = table(1).replace_schema_metadata({"trackslip": "[" + 100_000 * "[]," + "[]]"})
    pq.write_table(described, path)
    with pytest.raises(LogError, match=r"reading it may take \d+\.?\d* MB"):
        read_table(path, 1_000_000)


def test_the_runs_of_a_sweep_are_bounded_too(tmp_path, monkeypatch):
    path = tmp_path / "runs.parquet"
    rows = table(1_000_000).replace_schema_metadata(file_metadata({"a": {}}))
    pq.write_table(rows, path, row_group_size=1_000_000)
    monkeypatch.setattr("trackslip.memory.half_of_memory", lambda: LITTLE)
    with pytest.raises(LogError, match="reading it may take"):
        join_parquet([(path, "a", "b")], tmp_path / "joined.parquet")


def test_the_limit_is_half_of_the_memory_unless_given(tmp_path, monkeypatch):
    path = tmp_path / "log.csv"
    rows = (f"{time},1,1,{time},0,0\n" for time in range(20))
    path.write_text(",".join(NUMBERS) + "\n" + "".join(rows))
    monkeypatch.setattr("trackslip.memory.half_of_memory", lambda: 1000)
    with pytest.raises(LogError, match=r"must be at most 1 KB \(max_memory\)$"):
        trackslip.load(path)
    assert len(trackslip.load(path, max_memory=LITTLE)[0].time) == 20


def test_runs_count_however_short_they_are():
    many = table(300, run=[f"run {k}" for k in range(300)])
    with pytest.raises(LogError, match=r"log: reading it may take 1\.2 MB"):
        runs_from_table(many, "log", 1_000_000)


def test_the_lists_of_a_run_count_together():
    lists = pa.array([[0.0] * 5000] * 4)
    with pytest.raises(LogError, match=r"log: reading it may take 1\.2 MB"):
        runs_from_table(table(4, run=["a"] * 4, ranges=lists), "log", 1_000_000)
    with pytest.raises(LogError, match="none of the 4 runs can be used"):
        runs_from_table(table(4, run=list("abcd"), ranges=lists), "log", 1_000_000)
