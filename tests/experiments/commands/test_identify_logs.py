"""Logs as real robots make them, good and bad: identified correctly, or refused or listed in one line."""

import socket
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from trackslip.identification.identify import identify
from trackslip.kinematics import RobotGeometry, advance
from trackslip.slip.icr import ConstantIcr, IcrSides

pytestmark = pytest.mark.usefixtures("few_resamples")
ROBOT = RobotGeometry(half_gauge=0.3, sprocket_radius=0.08)
OPTIONS = ("--half-gauge", "0.3", "--sprocket-radius", "0.08")
LAW = ConstantIcr(0.09, 0.3, 0.015)
COLUMNS = ("run", "t", "omega_l", "omega_r", "x", "y", "phi")
TWISTS = tuple((v, v / r) for r in (0.8, 1.5, 3.0, -1.0, -2.0) for v in (0.3, 0.6))


def traces(law=LAW, twists=TWISTS, noise=0.003, duration=20.0, seed=0):
    """Rows (T, 7) of COLUMNS for each run, and the twists that the law gives."""
    rng = np.random.default_rng(seed)
    runs = []
    for k, twist in enumerate(np.array(twists)):
        time = np.arange(0, duration, 0.1)
        pose = advance([1.0, -2.0, 0.5], twist, time)
        pose = pose + rng.normal(0, 1, pose.shape) * [noise, noise, 1.5 * noise]
        omega = np.tile(law.sprocket_speeds(twist, ROBOT), (time.size, 1))
        runs.append([[f"run {k}", *row] for row in np.column_stack([time, omega, pose])])
    return runs


def written(runs, path, columns=COLUMNS):
    rows = [",".join(str(value) for value in row) for run in runs for row in run]
    path.write_text("\n".join([",".join(columns), *rows]))
    return str(path)


def scaled(runs, **factors):
    for run in runs:
        for row in run:
            for name, factor in factors.items():
                row[COLUMNS.index(name)] *= factor
    return runs


def values_of(found, name="icr_radius"):
    return found.comparison.laws[name].values


def test_turns_either_way_forwards_backwards_and_in_place(trackslip, tmp_path):
    backwards = [(-0.4, 0.3), (-0.3, -0.2)]
    in_place = [(0.0, 0.5), (0.0, -0.8)]
    log = written(traces(twists=(*TWISTS, *backwards, *in_place)), tmp_path / "log.csv")
    result = trackslip("identify", log, *OPTIONS)
    assert result.summary["outliers"] == []
    assert result.summary["samples"] == len(TWISTS) + 4
    assert result.summary["best"] == "icr_radius"
    law = result.summary["laws"]["icr_radius"]
    assert law["values"] == pytest.approx({"offset": 0.09, "radius_error": 0.015}, abs=0.002)
    keys = {"values", "stderr", "interval95", "rms", "aicc", "weight", "cv_radius", "cv_speed", "cv_yaw_rate"}
    assert keys <= set(law)
    low, high = law["interval95"]["offset"]
    assert low < 0.09 < high


def test_sides_that_differ(tmp_path):
    sides = IcrSides(0.07, 0.11, 0.0, 0.02, 0.3)
    log = written(traces(sides), tmp_path / "log.csv")
    found = identify(log, ROBOT, estimate_sensor=False, method="steady")
    assert found.best == "icr_sides"
    assert "left and right turns differ" in "".join(found.warnings)
    assert values_of(found, "icr_sides")["offset_right"] == pytest.approx(0.11, abs=0.004)
    assumed = identify(log, ROBOT, method="steady")
    assert any("to the left of the middle, if the ICRs of both sides are equal" in note for note in assumed.warnings)
    assert values_of(assumed)["offset"] == pytest.approx(0.09, abs=0.004)


def test_encoders_before_a_gear(refused, tmp_path):
    log = written(scaled(traces(), omega_l=30.0, omega_r=30.0), tmp_path / "log.csv")
    assert values_of(identify(log, ROBOT, gear=30.0, method="steady"))["offset"] == pytest.approx(0.09, abs=0.002)
    assert "it looks like a gear of about 29.6" in refused("identify", log, *OPTIONS)


@pytest.mark.parametrize(
    ("factors", "guess"),
    [
        ({"omega_l": 180 / np.pi, "omega_r": 180 / np.pi}, "deg/s"),
        ({"omega_l": 30 / np.pi, "omega_r": 30 / np.pi}, "rpm"),
        ({"x": 1000.0, "y": 1000.0}, "millimetres"),
        ({"x": 100.0, "y": 100.0}, "centimetres"),
        ({"phi": 180 / np.pi}, "degrees"),
        ({"phi": -1.0}, "headings fit the path clockwise"),
        ({"omega_l": -1.0}, "does its encoder count backwards?"),
        ({"omega_r": -1.0}, "right track moves"),
        ({"t": 1e3}, "times in ms"),
        ({"t": 1e9}, "times in ns"),
        ({"phi": -1.0, "y": -1.0}, "tracks swapped, or phi not counter-clockwise"),
    ],
)
def test_wrong_units_are_guessed(refused, tmp_path, factors, guess):
    assert guess in refused("identify", written(scaled(traces(), **factors), tmp_path / "log.csv"), *OPTIONS)


def test_swapped_tracks(refused, tmp_path):
    swapped = ("run", "t", "omega_r", "omega_l", "x", "y", "phi")
    line = refused("identify", written(traces(), tmp_path / "log.csv", swapped), *OPTIONS)
    assert "are the tracks swapped" in line
    assert "none of the 10 runs can be used" in line


def test_a_gear_that_is_a_little_wrong_is_doubted(tmp_path):
    log = written(scaled(traces(), omega_l=1.2, omega_r=1.2), tmp_path / "log.csv")
    assert "are gear and sprocket radius right?" in "".join(identify(log, ROBOT, method="steady").warnings)


def test_gaps_in_the_clock_and_poses_that_teleport_are_listed(tmp_path):
    runs = traces()
    for row in runs[0][50:]:
        row[1] += 30.0
    for row in runs[1][20:]:
        row[4] += 4.0
    runs[2][100][5] += 3.0
    found = identify(written(runs, tmp_path / "log.csv"), ROBOT, method="steady")
    warnings = " ".join(found.warnings)
    assert "run 'run 0': its clock has a gap from t = 4.9 s to 35 s" in warnings
    assert "run 'run 1': its pose jumps by" in warnings
    assert "run 'run 2': its pose jumps by" in warnings
    assert [name for name in found.samples.run if name.startswith("run 0")] == ["run 0 @ 1.5 s", "run 0 @ 36.5 s"]
    assert len(found.samples) == len(TWISTS) + 1
    assert values_of(found)["offset"] == pytest.approx(0.09, abs=0.003)


def test_rows_and_runs_that_cannot_be_read_are_listed(tmp_path):
    runs = traces()
    runs[1][7][1] = runs[1][6][1]
    runs[2][8][4] = "nan"
    for row in runs[3]:
        row[6] = np.degrees(row[6])
    found = identify(written(runs, tmp_path / "log.csv"), ROBOT, method="steady")
    assert found.warnings[:2] == (
        "run 'run 1': 1 row left out: row 208, column t: 0.6 is not after 0.6, the time before it",
        "run 'run 2': 1 pose left out: row 409, column x: 'nan' is not a finite number",
    )
    assert [refused.run for refused in found.outliers] == ["run 3"]
    assert "run 'run 3' left out: column phi: headings fit the path in degrees" in found.warnings[2]
    assert values_of(found)["offset"] == pytest.approx(0.09, abs=0.002)


def test_a_sprocket_at_rest_is_used(tmp_path):
    """Turning about one track, nearly: the encoder of the inner one says nothing, the robot's turn says all."""
    twist = (0.3, 0.3 / (0.3 + 0.09))
    found = identify(written(traces(twists=(*TWISTS, twist)), tmp_path / "log.csv"), ROBOT)
    assert found.outliers == ()
    assert len(found.samples) == len(TWISTS) + 1
    assert np.isnan(found.samples.slip[-1]).tolist() == [True, False]
    assert values_of(found)["offset"] == pytest.approx(0.09, abs=0.002)


def test_a_run_on_other_ground_is_an_outlier(tmp_path):
    runs = traces()
    other = traces(ConstantIcr(0.2, 0.3, 0.015), twists=((0.5, 0.4),))[0]
    for row in other:
        row[0] = "ice"
    found = identify(written([*runs, other], tmp_path / "log.csv"), ROBOT, method="steady")
    assert [outlier.run for outlier in found.outliers] == ["ice"]
    assert "run 'ice' left out" in " ".join(found.warnings)
    assert values_of(found)["offset"] == pytest.approx(0.09, abs=0.002)


def test_steady_samples_and_a_page_without_absolute_paths(trackslip, monkeypatch, tmp_path):
    twist = np.array([*TWISTS, (-0.3, 0.2), (0.0, 0.6)])
    omega = LAW.sprocket_speeds(twist, ROBOT) + np.random.default_rng(0).normal(0, 0.01, (len(twist), 2))
    rows = np.column_stack([30 * omega, twist])
    file = tmp_path / "samples.csv"
    file.write_text("\n".join(["omega_l,omega_r,v,w", *(",".join(map(str, row)) for row in rows)]))
    monkeypatch.chdir(tmp_path)
    arguments = ("identify", str(file), *OPTIONS, "--gear", "30", "--out", str(tmp_path / "here"))
    monkeypatch.setattr(sys, "argv", ["trackslip", *arguments])
    result = trackslip(*arguments)
    assert result.summary["laws"]["icr_radius"]["values"]["offset"] == pytest.approx(0.09, abs=0.01)
    assert result.summary["best"] == "icr_radius"
    page = (result.folder / "report.html").read_text(encoding="utf-8")
    assert "<code>trackslip identify samples.csv --half-gauge 0.3" in page
    assert "--out here</code>" in page
    assert str(tmp_path) not in page
    assert socket.gethostname() not in page


@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_samples(tmp_path, count):
    twist = np.array(TWISTS[: 2 * count : 2])
    rows = np.column_stack([LAW.sprocket_speeds(twist, ROBOT) * 1.001, twist])
    file = tmp_path / "samples.csv"
    file.write_text("\n".join(["omega_l,omega_r,v,w", *(",".join(map(str, row)) for row in rows)]))
    found = identify(file, ROBOT)
    assert "law exponential" in " ".join(found.warnings)  # which so few do not determine
    if count > 1:
        assert values_of(found)["offset"] == pytest.approx(0.09, abs=0.01)


def test_units_in_a_parquet_file_are_checked(refused, tmp_path):
    rows = [row for run in traces() for row in run]
    table = pa.table({name: [row[k] for row in rows] for k, name in enumerate(COLUMNS)})
    fields = [f.with_metadata({"unit": "deg/s"}) if f.name == "omega_l" else f for f in table.schema]
    pa.parquet.write_table(table.cast(pa.schema(fields)), tmp_path / "log.parquet")
    line = refused("identify", str(tmp_path / "log.parquet"), *OPTIONS)
    assert "column omega_l: in 'deg/s', must be in rad/s" in line
