import json
import re
import shutil
import subprocess

import numpy as np
import pytest
from deployed import GEOMETRY, VALUES, stored, twists
from diff_drive import PARAMETERS, DiffDrive, parameters_in, read_yaml

from trackslip.deploy.deploy import TARGETS, c_text, deploy_law
from trackslip.deploy.differential_drive import diff_drive_text
from trackslip.kinematics import advance
from trackslip.laws.families import FAMILIES
from trackslip.laws.file import SHIPPED, load_laws, read_stored

STORED = stored()
EVEN_SIDES = {
    "offset_left": 0.04,
    "offset_right": 0.04,
    "radius_error_left": 0.01,
    "radius_error_right": -0.02,
}
CASES = {
    "none": STORED,
    "icr": STORED,
    "icr_radius": STORED,
    "diff_drive": STORED,
    "icr_sides": stored({"icr_sides": EVEN_SIDES}),
}


@pytest.mark.parametrize("name", CASES)
def test_the_controller_moves_and_reckons_as_the_law_says(name):
    laws = CASES[name]
    twist = twists(500)
    parameters = parameters_in(diff_drive_text(laws, name))
    controller = DiffDrive.of(parameters)
    law = laws.laws[name]
    assert set(parameters) <= PARAMETERS
    assert all(type(value) is float for value in parameters.values())
    omega = law.sprocket_speeds(twist, GEOMETRY)
    np.testing.assert_allclose(controller.wheel_speeds(twist), omega, rtol=1e-12, atol=1e-12)
    reckoned = controller.twist(omega)
    np.testing.assert_allclose(reckoned, law.twist(omega, GEOMETRY), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("left", "right", "side"), [(0.04, 0.05, "right"), (0.05, 0.04, "left")])
def test_tracks_with_different_icrs_move_a_point_off_the_middle(left, right, side):
    """Its place is told; the yaw rate and the path of the robot are those of the law."""
    laws = stored({"icr_sides": EVEN_SIDES | {"offset_left": left, "offset_right": right}})
    text = diff_drive_text(laws, "icr_sides")
    distance = float(re.search(rf"([\d.]+) m to the {side} of the middle", text)[1])
    assert distance == pytest.approx(0.005)  # half the difference of D
    controller = DiffDrive.of(parameters_in(text))
    law = laws.laws["icr_sides"]
    omega = law.sprocket_speeds(twists(50), GEOMETRY)
    reckoned = controller.twist(omega)
    real = law.twist(omega, GEOMETRY)
    np.testing.assert_allclose(reckoned[:, 1], real[:, 1], rtol=1e-12, atol=1e-12)
    to_the_left = distance if side == "left" else -distance
    start = np.array([0.0, to_the_left, 0.0])
    ends = advance(start, reckoned, 0.5)
    middle = advance(np.zeros(3), real, 0.5)
    aside = to_the_left * np.stack([-np.sin(middle[:, 2]), np.cos(middle[:, 2])], axis=-1)
    np.testing.assert_allclose(ends[:, :2], middle[:, :2] + aside, atol=1e-12)


def test_variances_of_twists_add_up_to_the_slip_that_varies():
    """A filter that adds 500 twists of 20 ms at 1 m/s has the variance of 10 m of way."""
    noise = {"slip_forward": 0.02, "slip_sideways": 0.01, "slip_turn": 0.03}
    laws = stored(method="drive", drive={"laws": {"icr": {"noise": noise}}})
    controller = parameters_in(diff_drive_text(laws, "icr"))
    diagonal = np.array(controller["twist_covariance_diagonal"])
    expected = 10.0 * np.array([*noise.values()]) ** 2
    x_y_yaw = diagonal[[0, 1, 5]]
    np.testing.assert_allclose(500 * 0.02**2 * x_y_yaw, expected, rtol=1e-12)
    assert (diagonal[2:5] == 1e6).all()
    assert "twist_covariance_diagonal" not in diff_drive_text(laws, "icr_radius")


@pytest.mark.parametrize("unknown", ["forward", "sideways", "turn"])
def test_no_variance_is_0_where_drives_don_t_tell_it(unknown):
    """As with headings alone: to a filter, a variance of 0 is a velocity without error."""
    noise = {"slip_forward": 0.02, "slip_sideways": 0.01, "slip_turn": 0.03}
    noise[f"slip_{unknown}"] = 0.0
    laws = stored(method="drive", drive={"laws": {"icr": {"noise": noise}}})
    text = diff_drive_text(laws, "icr")
    assert "twist_covariance_diagonal" not in parameters_in(text)
    assert f"left out: the drives don't tell how much slip varies ({unknown})" in text


def test_ros_1_takes_the_same_parameters_in_its_own_form():
    two = deploy_law(SHIPPED, "ros2_control", "icr_radius")
    one = deploy_law(SHIPPED, "ros_control", "icr_radius")
    assert read_yaml(one) == {"diff_drive_controller": parameters_in(two)}


def test_the_named_law_replaces_a_best_law_that_is_inexpressible(tmp_path):
    file = tmp_path / "laws.json"
    content = stored(best="turn_loss", expressible="icr").content
    file.write_text(json.dumps(dict(content)))
    text = deploy_law(file)
    assert "Slip law icr: " in text
    assert "Warning: exported icr, not the best law (turn_loss)" in text
    assert "Slip law turn_loss" in deploy_law(file, "c")


def test_the_answer_is_deployed_even_if_the_best_law_could_be(tmp_path):
    file = tmp_path / "laws.json"
    content = stored(best="icr_sides", expressible="diff_drive").content
    file.write_text(json.dumps(dict(content)))
    controller = parameters_in(deploy_law(file))
    assert controller["left_wheel_radius_multiplier"] == pytest.approx(1.005)
    assert controller["right_wheel_radius_multiplier"] == pytest.approx(0.988)
    assert "Slip law icr_sides" in deploy_law(file, "c")


NASTY = '*/ int x; /* ??/ \\ \n\r\x00 */ é # : - "\'\'\'""" %s {0} \u2028 tail\\'
DRIVE = {
    "method": "drive",
    "best": "icr_radius",
    "made_by": NASTY,
    "alarms": [{"kind": "bound", "line": NASTY + " ±"}],
}


@pytest.mark.parametrize("to", TARGETS)
def test_nasty_names_stay_in_comments(to, tmp_path):
    laws = stored(**DRIVE)
    text = TARGETS[to](laws, "icr_radius")
    assert text.isascii()
    if to == "json":
        assert json.loads(text)["alarms"] == [NASTY + " ±"]
    elif to in ("ros2_control", "ros_control"):
        sections = 1 if to == "ros2_control" else 5
        assert len(read_yaml(text)["diff_drive_controller"]) == sections
    elif to == "python":
        names = {}
        exec(compile(text, "law", "exec"), names)
        public = {name for name in names if name.islower()}
        assert public == {"__builtins__", "sprocket_speeds", "body_twist"}
    elif shutil.which("cc"):
        (tmp_path / "law.h").write_text(text)
        options = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
        command = ["cc", *options, "-fsyntax-only", "-x", "c", "law.h"]
        subprocess.run(command, cwd=tmp_path, check=True)


@pytest.mark.parametrize("name", VALUES)
def test_json_is_a_file_of_laws_to_the_last_bit(name, tmp_path):
    file = tmp_path / "law.json"
    file.write_text(TARGETS["json"](stored(), name))
    assert load_laws(file, GEOMETRY) == {name: stored().laws[name]}
    if "c" in FAMILIES[name].targets:
        header = c_text(read_stored(file), name)
        assert header.count(f"{GEOMETRY.sprocket_radius!r};") == 1
    units = json.loads(file.read_text())["units"]
    assert set(units) == set(VALUES[name])


@pytest.mark.parametrize(
    "key", ["drive", "laws", "alarms", "method", "best", "made_by", "expressible"]
)
@pytest.mark.parametrize("value", [None, [1, [2]], {"icr": 3}])
def test_whatever_else_a_file_says(key, value):
    laws = stored({"icr": VALUES["icr"]}, **{"method": "drive", key: value})
    for text in TARGETS.values():
        assert text(laws, "icr")
