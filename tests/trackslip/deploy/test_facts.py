"""What deployed laws say of themselves, whatever names a log brings with it."""

import json
import shutil
import subprocess

import numpy as np
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
from trackslip.slip.exponential import PUBLISHED
from trackslip.slip.law_file import load_laws, read_stored

NASTY = '*/ int x; /* ??/ \\ \n\r\x00 */ é # : - "\'\'\'""" %s {0} \u2028 tail\\'
DRIVE = {
    "method": "drive",
    "best": "icr_radius",
    "drive": {
        "drives": [NASTY, "second"],
        "laws": {
            "icr_radius": {
                "extras": {"sensor_x": 0.3, "sensor_y": 0.1, "sensor_yaw": 0.087},
                "held": {"lag": "none shows", "sensor_yaw": "given"},
            }
        },
    },
    "prediction": {
        "none": {"10": {"heading_rms": np.radians(22.5), "position_rms": 0.325}},
        "icr_radius": {"10": {"heading_rms": np.radians(1.5), "position_rms": 0.065}},
    },
    "warnings": [NASTY, "law constant: left out", "the poses' stamps are 107 ± 2.6 ms late"],
}


@pytest.mark.parametrize("to", TARGETS)
def test_nasty_names_stay_in_comments(to, tmp_path):
    laws = stored(**DRIVE)
    text = TARGETS[to](laws, "icr_radius")
    assert text.isascii()
    if to == "json":
        assert json.loads(text)["identified_from"]["drives"] == [NASTY, "second"]
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


def test_the_comments_say_what_the_law_is_worth():
    lines = fact_lines(stored(**DRIVE), "icr_radius")
    said = "\n".join(lines)
    assert "Robot: half gauge b = 0.168 m, sprocket radius r = 0.06 m" in said
    assert "2 drives" in said
    assert "0.3000 m ahead, 0.1000 m to the left, turned by 4.98 deg" in said
    assert "10 s ahead: heading 22.5 deg -> 1.5 deg, position 325 mm -> 65 mm" in said
    assert "Odometry, 10 s ahead: heading 15 times better, position 5 times better" in said
    assert "warning: sensor_yaw is held: given" in said
    assert "none shows" not in said
    assert "107 +/- 2.6 ms late" in said
    assert "law constant" not in said  # that is another law's
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
    assert "log my log.mcap; 25 steady samples" in said
    assert str(tmp_path.parent) not in said
    assert "not known: no held-out prediction" in said


@pytest.mark.usefixtures("few_resamples")
def test_a_steady_identification_in_memory():
    found = identify_samples(
        Sampling(grid(PUBLISHED, radii=(0.63, 1.27, 2.53), speeds=(0.1, 0.2)), (), (), 1.0), GEOMETRY
    )
    text = trackslip.deploy_law(found, "c", "exponential")
    for name, value in vars(found.laws["exponential"]).items():
        assert f"trackslip_{name} = {float(value)!r};" in text
    low, high = found.intervals["exponential"]["alpha_outer"]
    assert f"95 % interval {low:.6g} to {high:.6g}" in text
    errors = {name: found.comparison.validation[name] for name in ("none", "exponential")}
    before, after = (f"{float(f'{1e3 * errors[name].yaw_rate:.3g}'):g} mrad/s" for name in ("none", "exponential"))
    assert f"at left-out radii: yaw rate {before} -> {after}" in text


@pytest.mark.parametrize("name", VALUES)
def test_json_is_a_file_of_laws_to_the_last_bit(name, tmp_path):
    file = tmp_path / "law.json"
    file.write_text(TARGETS["json"](stored(), name))
    assert load_laws(file, GEOMETRY) == {name: stored().laws[name]}
    assert c_text(read_stored(file), name).count(f"{GEOMETRY.sprocket_radius!r};") == 1
    units = json.loads(file.read_text())["units"]
    assert set(units) == set(VALUES[name])


def test_the_best_law_is_the_default():
    laws = stored(best="exponential")
    assert laws.law_named(None) == "exponential"
    assert laws.law_named("icr") == "icr"
    assert stored({"icr": VALUES["icr"]}).law_named(None) == "icr"
    assert "Slip law icr_radius" in deploy_law()  # that with the smallest error among the shipped
    with pytest.raises(LogError, match=r"nothing of which law is best: choose one of constant, exp"):
        stored().law_named(None)
    with pytest.raises(InvalidValueError, match=r"law = 'online': must be one of none, constant.*\(in laws.json\)"):
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


@pytest.mark.parametrize("key", ["drive", "prediction", "laws", "warnings", "method", "best", "made_by", "samples"])
@pytest.mark.parametrize("value", [None, 3, "text", [1, [2]], {"icr": 3}, {"icr": {"5": {"heading_rms": "x"}}}])
def test_whatever_else_a_file_says(key, value):
    laws = stored({"icr": VALUES["icr"]}, **{"method": "drive", key: value})
    for text in TARGETS.values():
        assert text(laws, "icr")
