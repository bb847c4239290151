"""The options that describe the world: robot, ground, radius error."""

import numpy as np
import pytest

from trackslip.logs.logfile import read_runs

SHORT = ("--radii", "1.0", "--speeds", "0.1", "--duration", "6")


def ground_of(result):
    (log,) = read_runs(result.folder / "runs.parquet")
    assert log.metadata["ground"] == result.manifest["ground"]
    return log.metadata["ground"]


def test_a_ground_by_name_with_changes(trackslip):
    ground = ground_of(trackslip("grid", *SHORT, "--ground", "gravel", "--ground.across", "0.5"))
    assert (ground["along"], ground["across"], ground["slope"]) == (0.35, 0.5, 0.0)


def test_a_ground_from_a_file(trackslip, tmp_path):
    path = tmp_path / "wet.toml"
    path.write_text("base = 'wet'\n[[patches]]\nx = [-inf, inf]\ny = [0.0, 1.0]\nalong = 0.2\nacross = 0.2\n")
    ground = ground_of(trackslip("grid", *SHORT, "--ground", str(path), "--ground.slope", "0.05"))
    assert (ground["along"], ground["slope"]) == (0.6, 0.05)
    assert ground["patches"][0]["along"] == 0.2
    assert ground["patches"][0]["x"] == [None, None]  # infinite


def test_a_robot_file_and_a_ground_that_overrides_its_own(trackslip, tmp_path):
    path = tmp_path / "robot.toml"
    path.write_text("half_gauge = 0.2\nradius_error = 0.03\n[ground]\nalong = 0.5\nacross = 0.6\n")
    own = trackslip("grid", *SHORT, "--robot", str(path))
    assert ground_of(own)["across"] == 0.6
    assert own.manifest["robot"]["half_gauge"] == 0.2
    (log,) = read_runs(own.folder / "runs.parquet")
    assert log.metadata["geometry"]["half_gauge"] == 0.2
    assert log.metadata["radius_error"] == 0.03
    speeds = log.truth.twist[-1, 0] / (0.06 * log.omega[-1].mean())
    assert speeds == pytest.approx(1.03, abs=0.01)
    other = trackslip("grid", *SHORT, "--robot", str(path), "--ground", "ice", "--radius-error", "0.0")
    assert ground_of(other)["across"] == 0.12
    assert read_runs(other.folder / "runs.parquet")[0].metadata["radius_error"] == 0.0


def test_a_slope_turns_the_path_downhill(trackslip):
    """Everything is measured in the plane of the ground: across a slope the robot slips down as it turns."""
    result = trackslip("grid", *SHORT, "--ground.slope", "0.2")
    (log,) = read_runs(result.folder / "runs.parquet")
    error = (log.pose - log.truth.pose)[log.is_valid]
    assert np.sqrt(np.mean(error[:, :2] ** 2)) < 0.006
    assert log.truth.torque[-1].sum() > 1.0  # it starts uphill


def test_predict_takes_a_robot_file(trackslip, tmp_path):
    path = tmp_path / "robot.toml"
    path.write_text("half_gauge = 0.336\ncontact_length = 0.68\n")
    law = trackslip("predict").summary["slip_laws"]["icr_radius"]["values"]["offset"]
    assert trackslip("predict", "--robot", str(path)).summary["slip_laws"]["icr_radius"]["values"][
        "offset"
    ] == pytest.approx(2 * law)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--ground", "mud"), "ground = 'mud': must be one of stone, concrete"),
        (("--ground", ""), "ground = ''"),
        (("--ground", "nowhere.toml"), "nowhere.toml: No such file"),
        (("--ground.across", "-1"), "ground.across = -1.0: must be a finite number > 0"),
        (("--ground.slope", "0.9"), "slope = 0.9: must be less than the friction angle"),
        (("--ground.slope", "-0.1"), "ground.slope = -0.1"),
        (("--ground.slope", "10"), "ground.slope = 10.0: must be at most 1.5 rad"),
        (("--robot", "nowhere.toml"), "nowhere.toml: No such file"),
        (("--drive.motor.gear", "0"), "gear = 0.0"),
        (("--drive.torque-limit", "0.1"), "drive.torque_limit = 0.1: must be more than motor.friction"),
    ],
)
def test_mistakes_get_one_line(refused, arguments, message):
    assert message in refused("grid", *SHORT, *arguments)


def test_bad_files_get_one_line(refused, tmp_path):
    (tmp_path / "bad.toml").write_text("along = [")
    for option in ("--ground", "--robot"):
        assert "bad.toml: not TOML" in refused("grid", *SHORT, option, str(tmp_path / "bad.toml"))
