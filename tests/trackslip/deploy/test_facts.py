"""What deployed laws say of themselves, whatever names a log brings with it."""

import json
import shutil
import subprocess

import pytest
from deployed import GEOMETRY, VALUES, stored
from diff_drive import read_yaml
from slip_data import grid

import trackslip
from trackslip.deploy.deploy import TARGETS, deploy_law
from trackslip.deploy.facts import fact_lines
from trackslip.deploy.programs import c_text
from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.identify import identify_samples
from trackslip.identification.samples import Sampling
from trackslip.laws.exponential import PUBLISHED
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


def test_the_comments_say_what_the_law_is():
    laws = stored(**DRIVE)
    laws.content["slip_laws"]["icr_radius"]["interval95"] = {"offset": [0.044, 0.046]}
    lines = fact_lines(laws, "icr_radius")
    said = "\n".join(lines)
    assert "offset = 0.045 [m], 95 % interval 0.044 to 0.046: distance from a track's centre line" in said
    assert "radius_error = 0.0067 [-], no interval" in said
    assert "Robot: half gauge b = 0.168 m, sprocket radius r = 0.06 m" in said
    assert lines[-1].startswith("ALARM: ")
    assert lines[-1].endswith("+/-")
    assert all(line.isascii() and line.isprintable() for line in lines)


def test_origin_and_intervals_are_those_of_the_folder(tmp_path):
    manifest = {
        "arguments": ["identify", "my log.mcap", "--half-gauge", "0.168"],
        "config": {"path": "my log.mcap"},
        "created": "2026-01-02T03:04:05+00:00",
        "versions": {"trackslip": "0.1.0"},
    }
    content = dict(stored().content)
    content["slip_laws"]["icr"]["interval95"] = {"offset": [0.0401, 0.0472]}
    (tmp_path / "summary.json").write_text(json.dumps(content | {"method": "steady", "samples": 25, "best": "icr"}))
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    said = deploy_law(tmp_path)
    assert "offset = 0.0436 [m], 95 % interval 0.0401 to 0.0472" in said
    assert "`trackslip identify 'my log.mcap' --half-gauge 0.168`, trackslip 0.1.0, 2026-01-02T03:04:05+00:00" in said
    assert str(tmp_path.parent) not in said


def test_a_steady_identification_in_memory():
    samples = Sampling(grid(PUBLISHED, radii=(0.63, 1.27, 2.53), speeds=(0.1, 0.2)), (), (), 1.0)
    found = identify_samples(samples, GEOMETRY)
    assert found.best == "exponential"
    text = trackslip.deploy_law(found, "c")
    assert f"The best law is exponential: this is {found.expressible}" not in text  # that is a comment of parameters
    assert f"Slip law {found.expressible}" in text
    low, high = found.intervals[found.expressible]["offset"]
    assert f"95 % interval {low:.6g} to {high:.6g}" in text
    assert f"The best law is exponential: this is {found.expressible}" in trackslip.deploy_law(found)


@pytest.mark.parametrize("name", VALUES)
def test_json_is_a_file_of_laws_to_the_last_bit(name, tmp_path):
    file = tmp_path / "law.json"
    file.write_text(TARGETS["json"](stored(), name))
    assert load_laws(file, GEOMETRY) == {name: stored().laws[name]}
    if "c" in FAMILIES[name].targets:
        assert c_text(read_stored(file), name).count(f"{GEOMETRY.sprocket_radius!r};") == 1
    units = json.loads(file.read_text())["units"]
    assert set(units) == set(VALUES[name])


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


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"slip_laws": {}}, "no slip laws in it"),
        ({"slip_laws": None}, "no slip laws in it"),
        ({"slip_laws": {"icr": {"values": {"offset": -0.2}}}}, r"icr.offset = -0.2: must be from -0.16632 to 8.4"),
        ({"slip_laws": {"icr": {"values": {"offset": float("nan")}}}}, r"icr.offset = nan: must be from"),
        ({"slip_laws": {"icr": {"values": {"offset": "4 cm"}}}}, r"icr.offset = '4 cm': must be a number"),
        ({"geometry": {"half_gauge": 0.168}}, "no slip laws in it"),
        ({"geometry": {"half_gauge": 0.168, "sprocket_radius": 0.0}}, "sprocket_radius = 0.0: must be from 0.001"),
        ({"geometry": {"half_gauge": float("nan"), "sprocket_radius": 0.06}}, "half_gauge = nan"),
        ({"format": 99}, "reads formats up to"),
        *((text, "laws.json: no") for text in ("", "{", "[]", "3", "\x00", '{"a": ' * 100_000)),
    ],
)
def test_files_that_are_refused(change, message, tmp_path):
    file = tmp_path / "laws.json"
    file.write_text(change if isinstance(change, str) else json.dumps(dict(stored().content) | change))
    with pytest.raises(LogError, match=message):
        deploy_law(file)


@pytest.mark.parametrize("key", ["drive", "laws", "alarms", "method", "best", "made_by", "expressible"])
@pytest.mark.parametrize("value", [None, 3, "text", [1, [2]], {"icr": 3}, {"icr": {"5": {"heading_rms": "x"}}}])
def test_whatever_else_a_file_says(key, value):
    laws = stored({"icr": VALUES["icr"]}, **{"method": "drive", key: value})
    for text in TARGETS.values():
        assert text(laws, "icr")
