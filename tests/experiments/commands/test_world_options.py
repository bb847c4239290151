"""The options that describe the world: robot, ground, radius error."""

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


def test_a_robot_too_heavy_for_its_motors_is_told_so(trackslip, tmp_path):
    """It drives, but not as it should: the summary says which run, and for how long."""
    path = tmp_path / "heavy.toml"
    path.write_text("mass = 100\n")
    result = trackslip("grid", "--radii", "1.0", "--speeds", "0.1", "--duration", "6", "--robot", str(path))
    (warning,) = result.summary["warnings"]
    assert warning.startswith("run 'radius=1.0 speed=0.1': a motor is at its limit for ")
    assert warning in result.printed
    assert result.manifest["robot"]["mass"] == 100.0


def test_a_grid_among_posts_remembers_them(trackslip):
    found = trackslip("grid", *SHORT, "--obstacles", "posts", "--scanner.quantisation", "0.01")
    assert len(found.manifest["obstacles"]["posts"]) == 5
    assert found.manifest["obstacles"]["walls"] == []
    assert found.manifest["config"]["obstacles"] == "posts"
    assert found.manifest["config"]["scanner"]["quantisation"] == 0.01
    assert found.summary["localization"]["valid_fraction"] > 0.5
