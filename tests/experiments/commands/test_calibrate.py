"""`trackslip calibrate`: published numbers, and scans of a known robot."""

import pytest
from command_runs import ran

from sim.drive.drive import RADIUS_ERROR
from sim.ground.ground import Ground
from sim.robot.named import load_parameters

ROBOT = "half_gauge = 0.19\ncontact_length = 0.36\nradius_error = 0.02\n[ground]\nalong = 0.5\nacross = {across}\n"


@pytest.fixture(scope="module")
def centred(tmp_path_factory):
    """Calibrated with the centre of mass in the middle, so that right turns mirror left ones."""
    options = ("calibrate", "--starts", "0", "--free", "friction_ratio", "radius_error")
    return ran(tmp_path_factory.mktemp("centred") / "out", *options).summary


def test_the_shipped_robot_is_the_calibrations_result(centred):
    values = {name: parameter["value"] for name, parameter in centred["parameters"].items()}
    assert set(values) == {"friction_ratio", "radius_error"}
    assert all(p["identifiable"] and p["stderr"] > 0 for p in centred["parameters"].values())
    assert values["friction_ratio"] * Ground().along == pytest.approx(Ground().across, abs=0.0011)
    assert values["radius_error"] == pytest.approx(RADIUS_ERROR, abs=0.0001)
    assert centred["slip_rms"] < 0.00715
    assert centred["radius_rms"] < 0.0495
    assert centred["floor"]["slip_rms"] <= centred["slip_rms"]
    assert len(centred["starts"]) == 1


@pytest.mark.slow
def test_published_numbers(trackslip, centred):
    """With a free lateral centre of mass, which the test on scans below covers by default."""
    result = trackslip("calibrate", "--starts", "0")
    found = result.summary
    assert set(found["parameters"]) == {"friction_ratio", "radius_error", "com_y"}
    assert all(p["identifiable"] and p["stderr"] > 0 for p in found["parameters"].values())
    assert found["slip_rms"] <= 0.0066
    assert found["radius_rms"] <= 0.046
    assert found["floor"]["slip_rms"] <= found["slip_rms"]
    assert found["slip_rms"] < found["centred"]["slip_rms"] <= 0.0072
    assert found["centred"]["parameters"] == centred["parameters"]
    assert "com_y = 0" in result.printed
    parameters, _ = load_parameters(result.folder / "robot.toml")
    assert parameters.com_y == found["parameters"]["com_y"]["value"]


def test_a_robot_is_found_from_its_scans(trackslip, tmp_path):
    (tmp_path / "true.toml").write_text(ROBOT.format(across=0.6))
    (tmp_path / "start.toml").write_text(ROBOT.format(across=0.5).replace("0.02", "0.0"))
    grid = trackslip("grid", "--robot", str(tmp_path / "true.toml"), "--radii", "0.6", "1.0", "2.0",
                     "--speeds", "0.2", "--duration", "15")  # fmt: skip
    found = trackslip(
        "calibrate", "--target", str(grid.folder), "--robot", str(tmp_path / "start.toml"), "--starts", "0"
    )
    truth = {"friction_ratio": 1.2, "radius_error": 0.02, "com_y": 0.0}
    for name, parameter in found.summary["parameters"].items():
        assert parameter["value"] == pytest.approx(truth[name], abs=3 * parameter["stderr"])
    assert found.summary["parameters"]["friction_ratio"]["stderr"] < 0.03
    assert set(found.summary["parameters"]) == set(truth)
    assert found.summary["slip_rms"] <= found.summary["centred"]["slip_rms"]
    assert "com_y = 0" in found.printed
    parameters, _ = load_parameters(found.folder / "robot.toml")
    assert parameters.com_y == found.summary["parameters"]["com_y"]["value"]
