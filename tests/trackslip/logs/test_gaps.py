"""Gaps in the clock: drives are cut there, and no time grid is sized by them."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from drives import GEOMETRY, SLAM, drive_log

from trackslip.errors import LogError
from trackslip.identification.identify import identify
from trackslip.logs.logfile import read_log, write_csv, write_parquet
from trackslip.logs.table_reader import runs_from_table

LOG = replace(drive_log(0, 60.0, SLAM, driving="random"), run="a", metadata={})
SET = 1.7e9  # time to which a clock is set in the middle of the drive [s]
ROW = len(LOG.time) // 2


def table_of(time, **columns):
    """A table with the drive's rows at other times."""
    numbers = {
        "t": time,
        "omega_l": LOG.omega[:, 0],
        "omega_r": LOG.omega[:, 1],
        "x": np.where(LOG.is_valid, LOG.pose[:, 0], np.nan),
        "y": np.where(LOG.is_valid, LOG.pose[:, 1], np.nan),
        "phi": np.where(LOG.is_valid, LOG.pose[:, 2], np.nan),
    }
    return pa.table(numbers | columns)


def clock_set():
    return LOG.time + np.where(np.arange(len(LOG.time)) < ROW, 0.0, SET)


@pytest.mark.parametrize("gyro", [False, True])
def test_a_drive_is_cut_where_its_clock_is_set(gyro):
    readings = {"gyro": 0.1 * np.sin(LOG.time)} if gyro else {}
    found = runs_from_table(table_of(clock_set(), **readings), "clock.csv")
    assert [run.run for run in found.runs] == ["clock, part 1", "clock, part 2"]
    assert "cut into 2 runs there" in found.warnings[0]
    assert f"row {ROW + 1}, column t" in found.warnings[0]
    assert sum(len(run.time) for run in found.runs) == len(LOG.time)


def test_a_cut_drive_is_identified_like_the_whole_one():
    whole = identify(LOG, GEOMETRY, method="drive")
    cut = runs_from_table(table_of(clock_set()), "clock.csv").runs
    parts = identify(cut, GEOMETRY, method="drive")
    name = "icr_radius"
    for key, value in whole.drive.laws[name].values.items():
        assert parts.drive.laws[name].values[key] == pytest.approx(value, abs=0.05)


@pytest.mark.parametrize("unit", [1e3, 1e6, 1e9])
def test_times_in_other_units_are_refused_when_read(unit):
    table = table_of(LOG.time * unit, gyro=0.1 * np.sin(LOG.time))
    with pytest.raises(LogError, match="per row: are these ms or ns"):
        runs_from_table(table, "ns.csv")


def test_stamps_beyond_64_bits_are_refused():
    stamps = pa.array([2**63 + int(1e9 * t) for t in LOG.time], pa.uint64())
    with pytest.raises(LogError, match="per row: are these ms or ns"):
        runs_from_table(table_of(stamps), "ns.csv")


def test_a_run_in_memory_has_no_gap():
    with pytest.raises(LogError, match=r"no row from t = .* s to .* s: cut it into drives"):
        replace(LOG, time=clock_set())


@pytest.mark.parametrize("write", [write_csv, write_parquet])
def test_a_run_of_another_clock_does_not_change_the_rest(write, tmp_path):
    file = tmp_path / ("a.csv" if write is write_csv else "a.parquet")
    write([LOG, replace(LOG, run="b", time=LOG.time + SET)], file)
    found = read_log(file)
    assert [run.run for run in found.runs] == ["a", "b"]
    assert not found.warnings
