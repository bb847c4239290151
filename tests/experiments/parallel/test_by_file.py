"""Large results of helpers, which come through a file."""

import os
import tempfile

import numpy as np
import pytest

from experiments.parallel.by_file import Filed, filed
from experiments.parallel.executors import helped


def result():
    table = np.arange(300_000.0).reshape(3, -1)
    return {"name": "runs", "table": table, "columns": table[:, ::2], "mask": table > 5, "none": np.empty((0, 3))}


def assert_same(found):
    expected = result()
    assert found.keys() == expected.keys()
    assert found["name"] == "runs"
    for name in ("table", "columns", "mask", "none"):
        np.testing.assert_array_equal(found[name], expected[name])
        assert found[name].dtype == expected[name].dtype


def test_a_large_result_is_read_from_its_file_which_is_deleted(tmp_path):
    answer = filed(str(tmp_path / "ours-"), result)
    assert isinstance(answer, Filed)
    (file,) = tmp_path.glob("ours-*")
    assert file.stat().st_size >= 300_000 * 8
    found = answer.read()
    assert list(tmp_path.iterdir()) == []
    assert_same(found)
    found["table"] += 1  # arrays are as good as any
    np.testing.assert_array_equal(found["table"], result()["table"] + 1)
    assert found["table"].ctypes.data % 64 == 0


@pytest.mark.parametrize("small", [None, "text", {"table": np.arange(10.0)}])
def test_a_small_result_is_returned_as_it_is(tmp_path, small):
    assert filed(str(tmp_path / "ours-"), lambda: small) is small
    assert list(tmp_path.iterdir()) == []


def test_a_result_without_room_for_a_file_is_returned_as_it_is(tmp_path):
    assert_same(filed(str(tmp_path / "nowhere" / "ours-"), result))


def test_a_file_that_can_not_be_written_whole_is_deleted(monkeypatch, tmp_path):
    opened = tempfile.NamedTemporaryFile

    def full(**options):
        file = opened(**options)
        monkeypatch.setattr(file, "write", fail)
        return file

    def fail(_part):
        raise OSError("no space left")

    monkeypatch.setattr(tempfile, "NamedTemporaryFile", full)
    assert_same(filed(str(tmp_path / "ours-"), result))
    assert list(tmp_path.iterdir()) == []


def test_it_arrives_from_a_helper():
    with helped(2) as workers:
        assert workers.begin(os.getpid)() != os.getpid()
        assert_same(workers.begin(result)())
