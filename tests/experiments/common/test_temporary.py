"""Temporary files of commands that run at the same time."""

import tempfile
from pathlib import Path

import pytest
from filelock import FileLock

from experiments.common import temporary
from experiments.common.temporary import temporary_files


@pytest.fixture
def parent(tmp_path, monkeypatch):
    """The system's folder of temporary files."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_a_folder_that_is_just_made_is_not_abandoned(parent, monkeypatch):
    """Another command cleans up between the making of the lock and its being held."""

    class SlowLock(FileLock):
        def __enter__(self):
            Path(self.lock_file).touch()
            Path(self.lock_file).with_name("file").touch()
            monkeypatch.setattr(temporary, "FileLock", FileLock)
            with temporary_files():  # another command
                pass
            return super().__enter__()

    monkeypatch.setattr(temporary, "FileLock", SlowLock)
    with temporary_files() as folder:
        assert (folder / "file").exists()


def test_a_folder_in_use_is_kept_and_an_abandoned_one_is_deleted(parent, monkeypatch):
    abandoned = parent / "trackslip-killed"
    abandoned.mkdir()
    (abandoned / ".lock").touch()
    with temporary_files() as folder:
        assert not abandoned.exists()
        monkeypatch.setattr(tempfile, "tempdir", str(parent))  # as of another command
        with temporary_files():
            assert folder.is_dir()
        monkeypatch.setattr(tempfile, "tempdir", str(folder))
    assert not folder.exists()
