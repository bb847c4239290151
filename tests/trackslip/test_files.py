import io
import zipfile

import numpy as np
import pytest

from trackslip.errors import LogError
from trackslip.files import MOST_ARRAYS, read_json, read_npz

SMALL = 1_000_000


def archive(path, **members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members.items():
            file.writestr(f"{name}.npy", content)
    return path


def stored(array):
    file = io.BytesIO()
    np.lib.format.write_array(file, array)
    return file.getvalue()


def test_arrays_come_back_by_name(tmp_path):
    path = tmp_path / "a.npz"
    arrays = {"a": np.arange(6.0).reshape(2, 3), "b": np.array("text"), "c": np.ones((2, 2)).T}
    np.savez(path, **arrays)
    read = read_npz(path)
    assert list(read) == list(arrays)
    for name, array in arrays.items():
        np.testing.assert_array_equal(read[name], array)


def test_arrays_that_unpack_to_too_much_are_refused(tmp_path):
    path = archive(tmp_path / "a.npz", a=stored(np.zeros(SMALL)), b=stored(np.zeros(SMALL)))
    assert path.stat().st_size < 100_000
    with pytest.raises(LogError, match=r"a\.npz: unpacks to 16 MB, must be at most 10 MB$"):
        read_npz(path, 10_000_000)


def test_arrays_that_state_more_than_they_hold_are_refused(tmp_path):
    honest = stored(np.zeros(1000))
    lying = honest.replace(b"'shape': (1000,), }         ", b"'shape': (1000000000000,), }")
    assert len(lying) == len(honest)
    with pytest.raises(ValueError, match=r"a\.npy states more numbers than it holds"):
        read_npz(archive(tmp_path / "a.npz", a=lying))


def test_arrays_of_objects_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, a=np.array([{}]))
    with pytest.raises(ValueError, match="allow_pickle=False"):
        read_npz(path)


def test_json_beyond_the_limit_is_refused_unread(tmp_path):
    path = tmp_path / "a.json"
    with path.open("wb") as file:
        file.truncate(MOST_ARRAYS + 1)  # a hole that takes no disk
    with pytest.raises(LogError, match=r"100000001 bytes long, must be at most 100000000$"):
        read_json(path)
