"""`trackslip grid`: what it stores, repeats exactly, and leaves when it is interrupted."""

import json
import shutil
import typing

import pytest

from experiments.options.world import Motion
from trackslip.identification.identify import identify
from trackslip.kinematics import RobotGeometry
from trackslip.logs.logfile import read_runs, write_csv
from trackslip.motion.methods import MOTION_METHODS

SMALL = ("--radii", "0.6", "1.5", "--speeds", "0.1", "0.2", "--duration", "8")
GEOMETRY = RobotGeometry(half_gauge=0.168, sprocket_radius=0.06)


@pytest.mark.usefixtures("few_resamples")
def test_small_grid_then_identify_then_csv(trackslip, tmp_path, capsys):
    grid = trackslip("grid", *SMALL, "--seed", "3")
    assert {path.name for path in grid.folder.iterdir()} == {
        "manifest.json",
        "runs.parquet",
        "summary.json",
        "table.parquet",
    }
    assert "4 runs of 8 s" in grid.printed
    assert grid.manifest["seed"] == 3
    assert grid.summary["radius"]["commanded"] == [0.6, 1.5]
    assert grid.summary["radius"]["published"] == [None, 2.05]
    runs = read_runs(grid.folder / "runs.parquet")
    assert [log.run for log in runs] == [f"radius={r} speed={v}" for r in (0.6, 1.5) for v in (0.1, 0.2)]

    found = trackslip("identify", str(grid.folder))
    assert (found.folder / "report.html").read_text().startswith("<!")
    offset = found.summary["slip_laws"]["icr_radius"]["values"]["offset"]
    assert offset == pytest.approx(0.0445, abs=0.005)
    assert "icr_radius" in found.printed

    # a real robot's log: the same without truth and metadata
    write_csv([log for log in runs], tmp_path / "full.csv")
    rows = (tmp_path / "full.csv").read_text().splitlines()
    header = rows[0].replace('"', "").split(",")
    wanted = [header.index(name) for name in ("run", "t", "omega_l", "omega_r", "x", "y", "phi")]
    (tmp_path / "real.csv").write_text("\n".join(",".join(row.split(",")[k] for k in wanted) for row in rows))
    real = identify(tmp_path / "real.csv", GEOMETRY)
    for name in ("exponential", "icr", "icr_radius"):
        ours, theirs = real.comparison.laws[name].values, found.summary["slip_laws"][name]["values"]
        for key in ours:
            # without the flag every pose counts as measured: the few bridged ones change little
            assert ours[key] == pytest.approx(theirs[key], rel=0.05, abs=0.002)
    capsys.readouterr()


@pytest.mark.usefixtures("few_resamples")
def test_every_motion_method_is_an_option_and_has_its_errors(trackslip):
    assert set(typing.get_args(Motion)) == set(MOTION_METHODS)
    result = trackslip("grid", *SMALL[:-1], "20", "--motion", "paper")
    errors = result.summary["slip_error"]
    assert set(errors) == {"outer", "inner", *MOTION_METHODS}
    assert errors["outer"] == errors["paper"]["outer"]
    for name, most in (("arc", 0.0006), ("paper", 0.05)):
        for track in ("outer", "inner"):
            assert abs(errors[name][track]["bias"]) + errors[name][track]["std"] < most
    found = [identify(result.folder, motion=name) for name in ("arc", "paper")]
    offsets = [one.comparison.laws["icr_radius"].values["offset"] for one in found]
    assert offsets[0] == pytest.approx(offsets[1], abs=0.003)


def test_same_seed_same_files_another_seed_others(trackslip, tmp_path):
    tables = []
    for seed, threads in ((5, 1), (5, 2), (6, 1)):
        grid = trackslip("grid", *SMALL, "--seed", str(seed), "--threads", str(threads))
        tables.append((grid.folder / "runs.parquet").read_bytes())
        shutil.rmtree(grid.folder)
    one, two, other = tables
    assert one == two
    assert one != other


def test_runs_that_cannot_be_used_are_stored_and_named(trackslip):
    """A short-sighted scanner loses the faster run before it is steady."""
    grid = ("--radii", "3.0", "--speeds", "0.05", "0.25", "--duration", "10")
    result = trackslip("grid", *grid, "--scanner.max-range", "1.5")
    assert len(read_runs(result.folder / "runs.parquet")) == 2
    (warning,) = result.summary["warnings"]
    assert "speed=0.25" in warning
    assert warning in result.printed
    assert None in result.summary["radius"]["observed"]


def test_older_results_are_replaced_and_other_files_left(trackslip, tmp_path):
    (tmp_path / "grid").mkdir()
    (tmp_path / "grid" / "notes.txt").write_text("mine")
    for name in ("summary.json", "report.html"):
        (tmp_path / "grid" / name).write_text("old, of another command")
    result = trackslip("grid", *SMALL)
    assert (result.folder / "notes.txt").read_text() == "mine"
    assert json.loads((result.folder / "summary.json").read_text())["radius"]
    assert not (result.folder / "report.html").exists()
