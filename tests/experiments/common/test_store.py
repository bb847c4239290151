"""A sweep's store reads only what it wrote itself."""

import json

import pytest

from experiments.common.sweep import Store
from trackslip.replacement import STORE

ROWS = [{"run": "a", "id": "1", "error": None, "slip": 0.1}]


@pytest.fixture
def kept(tmp_path):
    """The JSON file of a store with one run."""
    Store(tmp_path, {"1"}, anew=False).keep(ROWS, b"logs")
    (file,) = (tmp_path / STORE).glob("*.json")
    return file


def stored(kept):
    return Store(kept.parents[1], {"1"}, anew=False).rows


def test_kept_rows_are_read_again(kept):
    assert stored(kept) == {"1": ROWS[0]}


def test_rows_without_logs_are_read_again(tmp_path):
    Store(tmp_path, {"1"}, anew=False).keep(ROWS)
    assert Store(tmp_path, {"1"}, anew=False).rows == {"1": ROWS[0]}


@pytest.mark.parametrize(
    "text",
    [
        *("", "null", "3", '"text"', "[]", "[1]", "{}", '[{"run": "a"}]', "[" * 100_000),
        json.dumps(ROWS),
        json.dumps({"rows": ROWS, "logs": None, "digest": None}),
        json.dumps({"rows": 3, "logs": 4, "digest": 5}),
    ],
)
def test_a_file_of_another_form_holds_no_runs(kept, text):
    kept.write_text(text)
    assert stored(kept) == {}


def test_a_file_that_is_no_text_holds_no_runs(kept):
    kept.write_bytes(b"\xff\xfe")
    assert stored(kept) == {}


def test_a_folder_named_like_a_file_holds_no_runs(kept):
    kept.unlink()
    kept.mkdir()
    assert stored(kept) == {}


def test_a_changed_row_is_not_read(kept):
    kept.write_text(kept.read_text().replace("0.1", "0.2"))
    assert stored(kept) == {}


@pytest.mark.parametrize("logs", [None, b"", b"log", b"Logs"])
def test_runs_with_missing_or_damaged_logs_are_not_read(kept, logs):
    kept.with_suffix(".parquet").unlink()
    if logs is not None:
        kept.with_suffix(".parquet").write_bytes(logs)
    assert stored(kept) == {}
