"""Commands on ground that shears: sweeps, closed loops, validation, speed, recordings."""

import numpy as np
import pytest
from rrd import component

from trackslip.logs.logfile import read_runs

GRID = ("--radii", "1.0", "--speeds", "0.2", "--duration", "4", "--executor", "inline")


def rows(folder):
    return {log.run: log for log in read_runs(folder / "runs.parquet")}


@pytest.mark.slow
def test_a_sweep_over_shear_has_the_bits_of_each_grid_alone(trackslip, tmp_path):
    swept = trackslip("grid", *GRID, "--vary", "ground.shear=0,0.01", "--out", str(tmp_path / "both"))
    hard = trackslip("grid", *GRID, "--out", str(tmp_path / "hard"))
    soft = trackslip("grid", *GRID, "--ground.shear", "0.01", "--out", str(tmp_path / "soft"))
    both = list(rows(swept.folder).values())
    alone = [log for one in (hard, soft) for log in rows(one.folder).values()]
    for one, other in zip(both, alone, strict=True):
        np.testing.assert_array_equal(one.truth.pose, other.truth.pose)
    assert both[0].metadata["ground"].get("shear", 0.0) == 0
    assert both[1].metadata["ground"]["shear"] == 0.01
    assert np.abs(both[0].truth.pose[-1] - both[1].truth.pose[-1]).max() > 1e-3


@pytest.mark.slow
def test_recordings_show_how_far_the_ground_gives_way(trackslip):
    result = trackslip("grid", *GRID, "--ground", "clay", "--rrd")
    (log,) = rows(result.folder).values()
    assert log.truth.shear.shape == (len(log.time), 20)
    assert log.truth.contact.shape[1] == 20
    (file,) = (result.folder / "recordings").iterdir()
    _, colours = component(file, "/run/robot/chassis/shear", "colors")
    assert colours.shape == (len(log.time), 18)
    assert len(np.unique(colours)) > 10
