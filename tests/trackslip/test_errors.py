import os
import pickle
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from bags import open_bag

import trackslip
from sim.policy import Policy
from trackslip.errors import (
    InvalidValueError,
    LogError,
    OutputError,
    RunFailedError,
    TrackslipError,
    require_at_most,
    require_finite,
    require_non_negative,
    require_positive,
)
from trackslip.files import read_json, regular_file
from trackslip.kinematics import RobotGeometry
from trackslip.trajectory.named import load_reference

CHECKS = (
    require_positive,
    require_non_negative,
    require_finite,
    partial(require_at_most, limit=2.0),
)


@pytest.mark.parametrize("kind", [TrackslipError, LogError, OutputError, RunFailedError])
def test_line_breaks_in_names_leave_a_message_on_one_line(kind):
    error = kind("column a\nb\r\nc is missing")
    assert str(error) == str(pickle.loads(pickle.dumps(error))) == "column a b c is missing"


def test_long_values_are_shown_in_part_and_in_one_line():
    ramp = np.zeros((400, 400)) + np.arange(400)
    message = str(InvalidValueError("name", ramp, "short"))
    assert "\n" not in message
    message = str(InvalidValueError("name", "a" * 100_000 + "z", "short"))
    assert len(message) < 250
    assert message.startswith("name = 'aaa")
    assert message.endswith("aaz': must be short")


@pytest.mark.parametrize("check", CHECKS)
@pytest.mark.parametrize(
    "value", ["1", None, [1.0, 2.0], np.array([1.0, 2.0]), float("nan"), 1j, 10**400]
)
def test_what_is_no_number_is_refused_by_name(
    check: Callable[[str, object], None], value: object
) -> None:
    with pytest.raises(InvalidValueError, match=r"^mass = .*: must be "):
        check("mass", value)


@pytest.mark.parametrize(
    ("check", "value"), list(zip(CHECKS, (0.0, -1e-9, float("inf"), 2.1), strict=True))
)
def test_numbers_out_of_range_are_refused(
    check: Callable[[str, object], None], value: float
) -> None:
    with pytest.raises(InvalidValueError, match="mass"):
        check("mass", value)


def test_sizes_of_robots_in_other_units_are_refused():
    for size in (0.99e-3, 100.1):
        with pytest.raises(InvalidValueError, match=r"sprocket_radius = .* from 0\.001 to 100 m"):
            RobotGeometry(0.2, size)


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
    readers = (read_json, trackslip.load, load_reference)
    if not path.is_dir():
        readers += (open_bag, Policy.load)
    for read in readers:
        with pytest.raises(trackslip.TrackslipError, match=r"input\.csv"):
            read(path)
