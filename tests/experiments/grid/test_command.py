"""`trackslip grid`: stored files, repeatability, and the options of the world."""

import numpy as np
import pytest
from rrd import component

from trackslip.logs.logfile import read_runs

SMALL = ("--radii", "0.6", "1.5", "--speeds", "0.1", "0.2", "--duration", "8")
SHORT = ("--radii", "1.0", "--speeds", "0.1", "--duration", "6")
SHEAR = ("--radii", "1.0", "--speeds", "0.2", "--duration", "4", "--executor", "inline")


def test_same_seed_same_files_another_seed_others(trackslip, tmp_path):
    one, two, other = (
        trackslip("grid", *SMALL, "--seed", seed, "--threads", threads, "--out", str(tmp_path / (seed + threads)))
        for seed, threads in (("5", "1"), ("5", "2"), ("6", "1"))
    )
    stored = [(grid.folder / "runs.parquet").read_bytes() for grid in (one, two, other)]
    assert stored[0] == stored[1] != stored[2]
    assert {path.stem for path in one.folder.iterdir()} == {"manifest", "runs", "summary", "table"}
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


@pytest.mark.slow
def test_recordings_show_how_far_the_ground_gives_way(trackslip):
    result = trackslip("grid", *SHEAR, "--ground", "clay", "--rrd")
    (log,) = read_runs(result.folder / "runs.parquet")
    assert log.truth.shear.shape == (len(log.time), 20)
    (file,) = (result.folder / "recordings").iterdir()
    _, colours = component(file, "/run/robot/chassis/shear", "colors")
    assert colours.shape == (len(log.time), 18)
    assert len(np.unique(colours)) > 10
