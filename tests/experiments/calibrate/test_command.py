import pytest
from command_runs import ran

from sim.ground.ground import Ground, load_ground
from sim.robot.named import load_parameters
from sim.robot.parameters import RADIUS_ERROR, RobotParameters

ROBOT = (
    "half_gauge = 0.19\ncontact_length = 0.36\nradius_error = 0.02\n[ground]\nalong = "
    "0.5\nacross = {across}\n"
)


@pytest.fixture(scope="module")
def centred(tmp_path_factory):
    """Calibrated with the centre of mass in the middle, so that right turns mirror left ones."""
    options = ("calibrate", "--free", "friction_ratio", "radius_error")
    return ran(tmp_path_factory.mktemp("centred") / "out", *options).summary


def test_the_shipped_robot_is_the_calibrations_result(centred):
    values = {name: parameter["value"] for name, parameter in centred["parameters"].items()}
    assert set(values) == {"friction_ratio", "radius_error"}
    assert all(p["identifiable"] and p["stderr"] > 0 for p in centred["parameters"].values())
    assert values["friction_ratio"] * Ground().along == pytest.approx(Ground().across, abs=0.0011)
    assert values["radius_error"] == pytest.approx(RADIUS_ERROR, abs=0.0001)
    assert centred["slip_rms"] < 0.00715
    assert centred["radius_rms"] < 0.0495


@pytest.mark.slow
def test_published_numbers(trackslip, centred):
    """With a free lateral centre of mass, which the test on scans below covers by default."""
    result = trackslip("calibrate")
    found = result.summary
    assert set(found["parameters"]) == {"friction_ratio", "radius_error", "com_y"}
    assert all(p["identifiable"] and p["stderr"] > 0 for p in found["parameters"].values())
    assert found["slip_rms"] <= 0.0066
    assert found["radius_rms"] <= 0.046
    assert found["slip_rms"] < centred["slip_rms"] <= 0.0072
    page = (result.folder / "report.html").read_text()
    assert "Slip, rms: 0.0063 (calibrated), 0.0071 before" in page
    assert "friction_ratio" in page
    parameters, _ = load_parameters(result.folder / "robot.toml")
    assert parameters.com_y == found["parameters"]["com_y"]["value"]


def test_a_fitted_lag_names_a_robot_without_motors(tmp_path):
    robot = tmp_path / "robot.toml"
    robot.write_text(ROBOT.format(across=0.6))
    drives = ("--drives", "1", "--duration", "5")
    ran(tmp_path / "out", "wander", "--robot", str(robot), *drives)
    fit = ("--target", str(tmp_path / "out"), "--robot", str(robot), "--free")
    lag = ran(tmp_path / "lag", "calibrate", *fit, "lag")
    assert f"{robot} has no motors" in lag.printed
    radius = ran(tmp_path / "radius", "calibrate", *fit, "radius_error")
    assert "motors" not in radius.printed


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """Three teleoperated drives of 20 s by a robot with longer tracks, on another ground."""
    folder = tmp_path_factory.mktemp("driven")
    (folder / "true.toml").write_text(ROBOT.format(across=0.6))
    options = ("--robot", str(folder / "true.toml"), "--drives", "3", "--duration", "40")
    ran(folder / "out", "wander", *options)
    (folder / "start.toml").write_text(ROBOT.format(across=0.5).replace("0.02", "0.0"))
    return folder


@pytest.mark.slow
def test_a_robot_is_found_from_its_drives_and_drives_alike(driven, tmp_path):
    options = (
        "--target",
        str(driven / "out"),
        "--robot",
        str(driven / "start.toml"),
        "--folds",
        "2",
    )
    found = ran(
        tmp_path / "out",
        "calibrate",
        *options,
        "--free",
        "friction_ratio",
        "radius_error",
        "com_height",
    )
    parameters = found.summary["parameters"]
    for name, truth in (("friction_ratio", 1.2), ("radius_error", 0.02)):
        assert parameters[name]["low"] < truth < parameters[name]["high"]
        assert parameters[name]["stderr"] < 0.08
    assert parameters["com_height"]["vague"]
    assert "com_height: the target does not determine it" in found.printed
    out = found.summary["held_out"]
    assert out["calibrated"]["heading_5s_median"] < 0.7 * out["before"]["heading_5s_median"], out
    assert "held out, before" in found.printed
    assert "Position after 5 s, median: " in (found.folder / "report.html").read_text()
    ground = load_ground(str(found.folder / "ground.toml"))
    assert ground.across / ground.along == pytest.approx(parameters["friction_ratio"]["value"])
    assert load_parameters(found.folder / "robot.toml") == (
        RobotParameters(
            half_gauge=0.19,
            contact_length=0.36,
            **{name: parameters[name]["value"] for name in ("radius_error", "com_height")},
        ),
        ground,
    )
    known = (
        "--robot",
        str(found.folder / "robot.toml"),
        "--ground",
        str(found.folder / "ground.toml"),
    )
    models = ran(tmp_path / "evaluate", "evaluate", str(driven / "out"), *known).summary["models"]
    ahead = {name: model["after_seconds"]["5"]["position"]["rms"] for name, model in models.items()}
    assert ahead["robot"] < 0.6 * ahead["none"]
