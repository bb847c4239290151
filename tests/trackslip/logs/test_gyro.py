from dataclasses import replace

import numpy as np
import pytest

from trackslip.logs.logfile import read_log, write_csv, write_parquet
from trackslip.logs.runlog import RunLog

TIME = 0.05 * np.arange(800)
RATE = 0.6 * np.sin(0.5 * TIME)
HEADING = np.append(0.0, np.cumsum(RATE[1:] * np.diff(TIME)))


@pytest.fixture
def log():
    """A robot that turns to and fro on the spot, by a gyro with a little noise and bias."""
    noise = np.random.default_rng(0).normal(0.01, 0.01, len(TIME))
    omega = 5 * RATE[:, None] * [-1, 1]
    pose = np.column_stack([np.zeros((len(TIME), 2)), HEADING])
    return RunLog("a", TIME, omega, pose, gyro=RATE + noise)


def cells(log, gyro, path):
    """A CSV file of the log with these texts in the column gyro."""
    lines = ["run,t,omega_l,omega_r,x,y,phi,gyro"]
    for t, omega, pose, cell in zip(log.time, log.omega, log.pose, gyro, strict=True):
        row = ("a", t, *omega, *pose, cell)
        lines.append(",".join(map(str, row)))
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize(("write", "name"), [(write_csv, "a.csv"), (write_parquet, "a.parquet")])
def test_it_is_written_and_read_back(log, tmp_path, write, name):
    gyro = np.where(np.arange(len(TIME)) % 7 == 3, np.nan, log.gyro)
    write([replace(log, gyro=gyro), replace(log, run="b", gyro=None)], tmp_path / name)
    read = read_log(tmp_path / name)
    first, second = read.runs
    np.testing.assert_array_equal(first.gyro, gyro)
    assert second.gyro is None
    assert not read.warnings
    assert "gyro" in repr(first)
    np.testing.assert_array_equal(first.between(5, 20).gyro, gyro[5:20])


def test_an_empty_cell_takes_the_next_reading_of_the_same_second(log, tmp_path):
    """Every second cell is empty, and all from 5 to 7.5 s."""
    texts = [repr(value) for value in log.gyro.tolist()]
    texts[1::2] = [""] * (len(texts) // 2)
    texts[100:150] = [""] * 50
    (read,) = read_log(cells(log, texts, tmp_path / "a.csv")).runs
    np.testing.assert_array_equal(read.gyro[1:99:2], log.gyro[2:100:2])
    assert np.isnan(read.gyro[99:130]).all()
    assert np.isfinite(read.gyro[130:-1]).all()


def test_wild_readings_are_left_out_in_one_line(log, tmp_path):
    texts = [*map(repr, log.gyro.tolist())]
    texts[3] = "1e6"
    texts[4] = "inf"
    texts[5] = "fast"
    read = read_log(cells(log, texts, tmp_path / "a.csv"))
    assert np.isnan(read.runs[0].gyro[3:6]).all()
    (line,) = read.warnings
    reason = "row 4, column gyro: '1e6' is not a yaw rate of at most 100 rad/s"
    assert line == f"run 'a': 3 gyro readings left out: {reason}"
