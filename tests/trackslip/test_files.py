"""Files that aren't what they are taken for: pipes, devices, pointers, and small files that fill any memory."""

from __future__ import annotations

import os

import pytest
from bags import open_bag

import trackslip
from sim.ground.ground import load_ground
from sim.policy import load_network
from trackslip.errors import LogError, SettingsFileError
from trackslip.files import read_json, regular_file
from trackslip.trajectory.named import load_reference


def pointer(path):
    path.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 12\n")


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (os.mkfifo, "not a regular file"),
        (lambda path: path.symlink_to("/dev/zero"), "not a regular file"),
        (lambda path: path.symlink_to(path), "Too many levels of symbolic links"),
        (lambda path: path.mkdir(), "Is a directory"),
        (pointer, "a Git LFS pointer instead of the file"),
    ],
)
def test_only_regular_files_are_read(tmp_path, make, reason):
    path = tmp_path / "input.csv"
    make(path)
    with pytest.raises(OSError, match=reason):
        regular_file(path)
    readers = (read_json, trackslip.load, load_reference, open_bag, lambda path: load_network(path, "policy"))
    for read in readers[:3] if path.is_dir() else readers:
        with pytest.raises(trackslip.TrackslipError, match=r"input\.csv"):
            read(path)


@pytest.mark.parametrize("digits", [400, 5000])
def test_integers_of_any_length_are_read(tmp_path, digits):
    path = tmp_path / "laws.json"
    path.write_text(f'{{"geometry": {{"half_gauge": {"9" * digits}, "sprocket_radius": 0.06}}, "slip_laws": {{}}}}')
    with pytest.raises(LogError, match=r"half_gauge = inf: must be from 0\.001 to 100 m"):
        trackslip.load_laws(path)
    ground = tmp_path / "ground.toml"
    ground.write_text(f"along = {'9' * digits}\n")
    with pytest.raises(SettingsFileError, match=r"along = 9+|too many digits"):
        load_ground(str(ground))
