"""`trackslip grid` over axes: rows, ids, common scans, chosen runs, and equal results on every executor."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from sweeps import ONE, SHORT, SWEEP, logs

from experiments.common.run_table import chosen
from trackslip.errors import InvalidValueError, LogError
from trackslip.logs.logfile import read_runs


def test_every_combination_is_a_run_with_a_row(trackslip):
    result = trackslip("grid", *SWEEP, "--grounds", "stone", "ice")
    rows = pq.read_table(result.folder / "table.parquet").to_pylist()
    assert len(rows) == len(logs(result.folder)) == 16
    assert len({row["id"] for row in rows}) == len({row["run"] for row in rows}) == 16
    for row in rows:
        log = logs(result.folder)[row["id"]]
        assert log.run == row["run"]
        ground, along = log.metadata["ground"], {"stone": 0.7, "ice": 0.12}[row["ground"]]
        assert ground["along"] == along
        assert ground["across"] == pytest.approx(row["friction_ratio"] * along)
        assert (log.metadata["seed"], log.metadata["radius"]) == (row["seed"], row["radius"])
        assert row["slip_l"] == pytest.approx(row["true_slip_l"], abs=0.01)
        assert row["omega_r"] == pytest.approx(log.omega[-20:, 1].mean(), rel=1e-3)
    assert [grid["runs"] for grid in result.summary["grids"]] == [2] * 8
    assert "16 runs in 8 grids" in result.printed
    schema = pq.read_schema(result.folder / "table.parquet")
    for field in schema:
        assert set(field.metadata) == {b"unit", b"description"}, field.name
        assert field.metadata[b"description"], field.name


def test_runs_keep_their_ids_and_bits_when_others_come(trackslip, tmp_path):
    few = logs(trackslip("grid", *SHORT, "--vary", "slope=0.05", "--out", str(tmp_path / "few")).folder)
    more = logs(trackslip("grid", *SHORT, "--seeds", "3", "0", "--vary", "slope=0,0.05", "drive.lag=0.05,0.08").folder)
    assert set(few) < set(more)
    for key, log in few.items():
        for ours, theirs in ((log.pose, more[key].pose), (log.truth.pose, more[key].truth.pose)):
            np.testing.assert_array_equal(ours, theirs)
    noise = [log.pose[:, :2] - log.truth.pose[:, :2] for log in more.values()]
    assert len({part.tobytes() for part in noise}) == len(more)


def test_methods_are_compared_on_the_same_scans(trackslip, tmp_path):
    """Ranges are identical for every method; another seed draws other noise."""
    found = []
    for k, options in enumerate(((), ("--motion", "arc"), ("--localization", "line"), ("--seed", "1"))):
        folder = trackslip("grid", *ONE, *options, "--out", str(tmp_path / str(k))).folder
        found += read_runs(folder / "runs.parquet")
    usual, *same, other = (log.scans.cluster.range for log in found)
    for ranges in same:
        np.testing.assert_array_equal(ranges, usual)
    assert not np.array_equal(other, usual)
    assert len({log.metadata["id"] for log in found}) == 4


@pytest.mark.slow
def test_a_law_is_identified_from_runs_of_one_setting(trackslip, refused):
    small = ("--radii", "0.6", "1.5", "--speeds", "0.1", "0.2", "--duration", "8", "--executor", "inline")
    folder = str(trackslip("grid", *small, "--vary", "friction_ratio=1.0,1.2", "--seeds", "0", "1").folder)
    unknown, missing = ("--where", "colour=red"), ("--where", "friction_ratio=1.1")
    assert "its runs differ in ground (across): choose with --where" in refused("identify", folder)
    assert "must be NAME=VALUE with one of seed, friction_ratio, " in refused("identify", folder, *unknown)
    assert "must be friction_ratio=one of 1.0, 1.2" in refused("identify", folder, *missing)
    found = trackslip("identify", folder, "--where", "friction_ratio=1.2", "seed=1")
    assert found.summary["samples"] == 4
    assert found.summary["slip_laws"]["icr"]["values"]["offset"] > 0.05  # 40 % more friction across doubles it
    assert len(chosen(Path(folder), ["friction_ratio=1", "radius=0.6"])) == 4


def test_runs_are_chosen_from_a_table_of_runs_only(tmp_path):
    pq.write_table(pa.table({"radius": [0.6]}), tmp_path / "table.parquet")
    with pytest.raises(LogError, match=r"table\.parquet: column run is missing"):
        chosen(tmp_path, ["radius=0.6"])
    pq.write_table(pa.table({"run": ["a", "b"], "radius": [[0.6], [1.0]]}), tmp_path / "table.parquet")
    with pytest.raises(InvalidValueError, match=r"must be radius=one of \[0.6\], \[1.0\]"):
        chosen(tmp_path, ["radius=0.6"])
