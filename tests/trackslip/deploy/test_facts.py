"""What deployed laws say of themselves, whatever names a log brings with it."""

import json
import shutil
import subprocess

import pytest
from deployed import GEOMETRY, VALUES, stored
from diff_drive import read_yaml

from trackslip.deploy.deploy import TARGETS, deploy_law
from trackslip.deploy.programs import c_text
from trackslip.errors import InvalidValueError, LogError
from trackslip.laws.families import FAMILIES
from trackslip.laws.file import SHIPPED, load_laws, read_stored

NASTY = '*/ int x; /* ??/ \\ \n\r\x00 */ é # : - "\'\'\'""" %s {0} \u2028 tail\\'
DRIVE = {"method": "drive", "best": "icr_radius", "made_by": NASTY, "alarms": [{"kind": "bound", "line": NASTY + " ±"}]}


@pytest.mark.parametrize("to", TARGETS)
def test_nasty_names_stay_in_comments(to, tmp_path):
    laws = stored(**DRIVE)
    text = TARGETS[to](laws, "icr_radius")
    assert text.isascii()
    if to == "json":
        assert json.loads(text)["alarms"] == [NASTY + " ±"]
    elif to in ("ros2_control", "ros_control"):
        assert len(read_yaml(text)["diff_drive_controller"]) == (1 if to == "ros2_control" else 5)
    elif to == "python":
        names = {}
        exec(compile(text, "law", "exec"), names)
        assert {name for name in names if name.islower()} == {"__builtins__", "sprocket_speeds", "body_twist"}
    elif shutil.which("cc"):
        (tmp_path / "law.h").write_text(text)
        command = ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-fsyntax-only", "-x", "c", "law.h"]
        subprocess.run(command, cwd=tmp_path, check=True)


@pytest.mark.parametrize("name", VALUES)
def test_json_is_a_file_of_laws_to_the_last_bit(name, tmp_path):
    file = tmp_path / "law.json"
    file.write_text(TARGETS["json"](stored(), name))
    assert load_laws(file, GEOMETRY) == {name: stored().laws[name]}
    if "c" in FAMILIES[name].targets:
        assert c_text(read_stored(file), name).count(f"{GEOMETRY.sprocket_radius!r};") == 1
    units = json.loads(file.read_text())["units"]
    assert set(units) == set(VALUES[name])


def test_intervals_are_those_that_are_stored():
    fit = {"values": VALUES["icr_radius"], "interval95": {"offset": [0.04, 0.05], "radius_error": [0.0, None]}}
    laws = stored(slip_laws={"icr_radius": fit})
    intervals = json.loads(TARGETS["json"](laws, "icr_radius"))["slip_laws"]["icr_radius"]["interval95"]
    assert intervals == {"offset": [0.04, 0.05], "radius_error": None}
    assert "95 % interval 0.04 to 0.05" in TARGETS["c"](laws, "icr_radius")


def test_the_best_law_is_the_default():
    laws = stored(best="exponential")
    assert laws.law_named(None) == "exponential"
    assert laws.law_named("icr") == "icr"
    assert stored({"icr": VALUES["icr"]}).law_named(None) == "icr"
    assert "Slip law icr_radius" in deploy_law(SHIPPED)  # that with the smallest error among the shipped
    with pytest.raises(LogError, match=r"nothing of which law is best: choose one of exponential"):
        stored().law_named(None)
    with pytest.raises(InvalidValueError, match=r"law = 'online': must be one of none, exponential.*\(in laws.json\)"):
        stored().law_named("online")


@pytest.mark.parametrize("key", ["drive", "laws", "alarms", "method", "best", "made_by", "expressible"])
@pytest.mark.parametrize("value", [None, 3, "text", [1, [2]], {"icr": 3}, {"icr": {"5": {"heading_rms": "x"}}}])
def test_whatever_else_a_file_says(key, value):
    laws = stored({"icr": VALUES["icr"]}, **{"method": "drive", key: value})
    for text in TARGETS.values():
        assert text(laws, "icr")
