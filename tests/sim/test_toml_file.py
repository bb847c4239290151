"""Files that nobody writes by accident, or only just: each is one line that names the file and the field."""

import pytest

from sim.ground.named import NAMED_GROUNDS, load_ground
from sim.robot.parameters import load_robot_file
from trackslip.errors import InvalidValueError, SettingsFileError

PATCH = "[[patches]]\ny = [0, 1]\nalong = 1\nacross = 1\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"along = {'9' * 400}", "along = 999"),  # too large for a float
        (f"along = {'9' * 5000}", "not TOML (Exceeds the limit"),  # too long for Python to read
        (f"along = 0x{'f' * 6000}", "along = a huge number: must be a number of moderate size"),  # and to write
        (f"patches = 0x{'f' * 6000}", "patches = a huge number: must be a list"),
        (f"patches = {list(range(10_000))}", "patches[0]: 0 is not a table"),
        (f"along = {list(range(10_000))}", "along = [0, 1, 2,"),
        ("a = " + "[" * 5000, "not TOML (maximum recursion"),
        ("along" + ".x" * 5000 + " = 1", "nested too deeply, at most 20 levels are allowed"),
        (f"along = {'[' * 300}{']' * 300}", "nested too deeply"),
        ("along = 1979-05-27", "along = datetime.date(1979, 5, 27): must be a number"),
        ("along = [0.7]", "along = [0.7]: must be a number"),
        ("[along]\nx = 1", "along = {'x': 1}: must be a number"),
        ("[base]\nx = 1", "base = {'x': 1}: must be one of stone"),
        ("along = 1\nalong = 2", "not TOML (Cannot overwrite"),
        (PATCH + "x = [false, true]", "patches[0]: x = False: must be a number"),
        (PATCH + "x = [[0], [1]]", "patches[0]: x = [0]: must be a number"),
        (PATCH + "x = []", "patches[0]: x = (): must be two ascending numbers"),
        (PATCH + "x = [nan, 1]", "patches[0]: x = (nan, 1.0): must be two ascending numbers"),
        (PATCH + "x = [0, 1]\nz = [0, 1]", "patches[0]: z is unknown; known are x, y, along, across"),
        (PATCH, "patches[0]: x is missing"),
        ("[patches]\nx = [0, 1]", "patches = {'x': [0, 1]}: must be a list"),
        ("[[changes]]\ntime = inf\nalong = 1\nacross = 1", "changes[0]: time = inf: must be a finite number"),
    ],
)
def test_one_short_line_with_file_and_field(tmp_path, text, message):
    path = tmp_path / "ground.toml"
    path.write_text(text)
    with pytest.raises(SettingsFileError) as error:
        load_ground(str(path))
    line = str(error.value)
    assert line.startswith(str(path))
    assert message in line
    assert "\n" not in line
    assert len(line) < len(str(path)) + 200


def test_names_that_are_no_files():
    for name in ("", "x" * 5000, "/dev/null/below"):
        with pytest.raises(InvalidValueError, match=r"ground = .*: must be one of stone, concrete"):
            load_ground(name)
    with pytest.raises(SettingsFileError, match="File name too long"):
        load_ground("x" * 5000 + ".toml")


def test_files_that_are_none(tmp_path):
    for path in (tmp_path, tmp_path / "none.toml"):
        with pytest.raises(SettingsFileError, match=r"Is a directory|No such file"):
            load_robot_file(path)
    with pytest.raises(SettingsFileError, match="Is a directory"):
        load_ground(str(tmp_path))


def test_an_empty_file_is_the_default(tmp_path):
    path = tmp_path / "nothing.toml"
    path.write_text("# nothing\n")
    assert load_ground(str(path)) == NAMED_GROUNDS["stone"].ground
