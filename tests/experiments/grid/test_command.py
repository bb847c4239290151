"""`trackslip grid`: stored files, repeatability, and the options of the world."""

import numpy as np
import pytest
from rrd import component
from slip_data import slip_errors

from trackslip.identification.identify import identify
from trackslip.kinematics import RobotGeometry
from trackslip.logs.logfile import read_runs

SMALL = ("--radii", "0.6", "1.5", "--speeds", "0.1", "0.2", "--duration", "8")
SHORT = ("--radii", "1.0", "--speeds", "0.1", "--duration", "6")
SHEAR = ("--radii", "1.0", "--speeds", "0.2", "--duration", "4", "--executor", "inline")
GEOMETRY = RobotGeometry(half_gauge=0.168, sprocket_radius=0.06)


@pytest.mark.slow
def test_errors_of_slip_are_those_of_the_chosen_motion_method(trackslip):
    result = trackslip("grid", *SMALL[:-1], "20", "--motion", "paper")
    (grid,) = result.summary["grids"]
    for name, most in (("arc", 0.0006), ("paper", 0.05)):
        errors = slip_errors(result.folder, name)
        assert (np.abs(errors.mean(axis=0)) + errors.std(axis=0) < most).all()
    outer, inner = (grid["slip_error"][track]["bias"] for track in ("outer", "inner"))
    assert (inner, outer) == pytest.approx(tuple(errors.mean(axis=0)))  # of the last method, the chosen one
    found = [identify(result.folder, motion=name, method="steady") for name in ("arc", "paper")]
    offsets = [one.comparison.laws["icr_radius"].values["offset"] for one in found]
    assert offsets[0] == pytest.approx(offsets[1], abs=0.003)


def test_same_seed_same_files_another_seed_others(trackslip, tmp_path):
    one, two, other = (
        trackslip("grid", *SMALL, "--seed", seed, "--threads", threads, "--out", str(tmp_path / (seed + threads)))
        for seed, threads in (("5", "1"), ("5", "2"), ("6", "1"))
    )
    stored = [(grid.folder / "runs.parquet").read_bytes() for grid in (one, two, other)]
    assert stored[0] == stored[1] != stored[2]
    assert {path.name for path in one.folder.iterdir()} == {
        *("manifest.json", "runs.parquet", "summary.json", "table.parquet")
    }
    assert one.manifest["seed"] == 5
    (radii,) = (each["radius"] for each in one.summary["grids"])
    assert (radii["commanded"], radii["published"]) == ([0.6, 1.5], [None, 2.05])
    names = [log.run for log in read_runs(one.folder / "runs.parquet")]
    assert names == [f"radius={r} speed={v}" for r in (0.6, 1.5) for v in (0.1, 0.2)]


def test_runs_that_cannot_be_used_are_stored_and_named(trackslip):
    """A short-sighted scanner loses the faster run before it is steady."""
    grid = ("--radii", "3.0", "--speeds", "0.05", "0.25", "--duration", "10")
    result = trackslip("grid", *grid, "--scanner.max-range", "1.5")
    assert len(read_runs(result.folder / "runs.parquet")) == 2
    (warning,) = result.summary["warnings"]
    assert "speed=0.25" in warning
    assert warning in result.printed
    (observed,) = result.summary["grids"][0]["radius"]["observed"]
    assert observed == pytest.approx(result.summary["runs"][0]["observed_radius"])


# the world


def ground_of(result):
    (log,) = read_runs(result.folder / "runs.parquet")
    assert log.metadata["ground"] == result.manifest["ground"]
    return log.metadata["ground"]


def test_a_ground_by_name_or_from_a_file_with_changes(trackslip, tmp_path):
    ground = ground_of(trackslip("grid", *SHORT, "--ground", "gravel", "--ground.across", "0.5"))
    assert (ground["along"], ground["across"], ground["slope"]) == (0.35, 0.5, 0.0)
    path = tmp_path / "wet.toml"
    path.write_text("base = 'wet'\n[[patches]]\nx = [-inf, inf]\ny = [0.0, 1.0]\nalong = 0.2\nacross = 0.2\n")
    ground = ground_of(trackslip("grid", *SHORT, "--ground", str(path), "--ground.slope", "0.05"))
    assert (ground["along"], ground["slope"], ground["patches"][0]["along"]) == (0.6, 0.05, 0.2)
    assert ground["patches"][0]["x"] == [None, None]  # infinite


def test_a_robot_file_and_a_ground_that_overrides_its_own(trackslip, tmp_path):
    path = tmp_path / "robot.toml"
    path.write_text("half_gauge = 0.2\nradius_error = 0.03\n[ground]\nalong = 0.5\nacross = 0.6\n")
    own = trackslip("grid", *SHORT, "--robot", str(path))
    assert ground_of(own)["across"] == 0.6
    assert own.manifest["robot"]["half_gauge"] == 0.2
    (log,) = read_runs(own.folder / "runs.parquet")
    assert (log.metadata["geometry"]["half_gauge"], log.metadata["radius_error"]) == (0.2, 0.03)
    assert log.truth.twist[-1, 0] / (0.06 * log.omega[-1].mean()) == pytest.approx(1.03, abs=0.01)
    other = trackslip("grid", *SHORT, "--robot", str(path), "--ground", "ice", "--radius-error", "0.0")
    assert ground_of(other)["across"] == 0.12
    assert read_runs(other.folder / "runs.parquet")[0].metadata["radius_error"] == 0.0


@pytest.mark.slow
def test_a_robot_too_heavy_for_its_motors_is_named(trackslip):
    result = trackslip("grid", *SHORT, "--vary", "robot.mass=25,100")
    (warning,) = result.summary["warnings"]
    assert warning.startswith("run 'radius=1.0 speed=0.1 robot.mass=100.0': a motor is at its limit for ")
    assert warning in result.printed


@pytest.mark.slow
def test_recordings_show_how_far_the_ground_gives_way(trackslip):
    result = trackslip("grid", *SHEAR, "--ground", "clay", "--rrd")
    (log,) = read_runs(result.folder / "runs.parquet")
    assert log.truth.shear.shape == (len(log.time), 20)
    (file,) = (result.folder / "recordings").iterdir()
    _, colours = component(file, "/run/robot/chassis/shear", "colors")
    assert colours.shape == (len(log.time), 18)
    assert len(np.unique(colours)) > 10
