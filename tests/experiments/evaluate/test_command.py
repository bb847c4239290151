"""`trackslip evaluate`: errors of odometry, the sensor's place, and refusals."""

import json
from dataclasses import replace

import numpy as np
import pyarrow.parquet
import pytest
from drives import EXACT, GEOMETRY, ICR, STILL, drive_log, without_poses
from wandered import identified_from, wandered

from experiments.common.plain_json import write_json
from sim.wander.motion import LASTING
from trackslip.identification.result import identification_to_json
from trackslip.logs.logfile import write_parquet
from trackslip.slip.law_file import save_laws

OPTIONS = ("--half-gauge", "0.168", "--sprocket-radius", "0.06")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The results of an identification."""
    out = tmp_path_factory.mktemp("mine")
    write_json(out / "summary.json", identification_to_json(identified_from(wandered(duration=15.0))))
    return str(out)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The true law, and logs of drives that follow it exactly."""
    out = tmp_path_factory.mktemp("logs")
    save_laws(out / "true.json", {"icr_radius": ICR}, GEOMETRY)
    logs = [drive_log(seed, duration, EXACT, STILL) for seed, duration in ((0, 90.0), (1, 20.0))]
    write_parquet(logs, out / "two.parquet")
    write_parquet([without_poses(logs[0], logs[0].is_valid)], out / "no_poses.parquet")
    return out


def test_the_true_law_is_right_and_none_is_not(trackslip, files):
    true = f"{files / 'true.json'}:icr_radius"
    result = trackslip("evaluate", str(files / "two.parquet"), "--law", true, "--law", "none", "--pdf")
    laws = result.summary["laws"]
    assert list(laws) == ["icr_radius", "none"]
    page = (result.folder / "report.html").read_text()
    assert "Odometry by slip laws on “two.parquet”" in page
    assert laws["icr_radius"]["from_first"]["position"]["largest"] < 1e-9
    for lengths in ("after_metres", "after_seconds"):
        assert list(laws["none"][lengths]) == ["1", "2", "5", "10"]
        for length, errors in laws["icr_radius"][lengths].items():
            assert errors["position"]["largest"] < 1e-9
            assert errors["heading"]["largest"] < 1e-9
            assert errors["count"] == laws["none"][lengths][length]["count"]
    assert laws["none"]["after_metres"]["10"]["position_per_way"] > 0.03
    assert [drive["name"] for drive in result.summary["drives"]["none"]] == ["drive 0", "drive 1"]
    assert "times better" in result.printed.splitlines()[-2]
    assert sorted(file.name for file in result.folder.iterdir()) == [
        "figures", "manifest.json", "report.html", "summary.json", "table.parquet", "trajectories",
    ]  # fmt: skip
    rows = pyarrow.parquet.read_table(result.folder / "table.parquet").to_pylist()
    row = next(row for row in rows if (row["law"], row["kind"], row["length"]) == ("none", "metres", 5.0))
    known = laws["none"]["after_metres"]["5"]
    assert (row["heading_per_way"], row["count"]) == (known["heading_per_way"], known["count"])


def test_sensor_and_clock_are_those_of_the_identification_unless_given(trackslip, files, folder):
    log = str(files / "two.parquet")
    known = json.loads((files.parent / folder / "summary.json").read_text())
    extras = known["drive"]["laws"][known["best"]]["extras"]
    result = trackslip("evaluate", log, "--law", folder, "--law", "none")
    for law in result.summary["laws"].values():
        place = {"x": extras["sensor_x"], "y": extras["sensor_y"], "yaw": pytest.approx(extras["sensor_yaw"])}
        assert law["sensor"] == place
        assert law["clock_offset"] == extras["clock_offset"] - extras["lag"]
    assert result.summary["geometry"] == known["geometry"]
    other = trackslip("evaluate", log, "--law", f"{folder}:icr", "--law", f"{folder}:icr_radius").summary["laws"]
    assert other["icr"]["sensor"]["x"] == known["drive"]["laws"]["icr"]["extras"]["sensor_x"]
    assert other["icr"]["sensor"]["x"] != other["icr_radius"]["sensor"]["x"]
    assert "(as identified)" in result.printed
    given = trackslip("evaluate", log, "--law", folder, "--sensor", "0.1", "-0.2", "0.3", "--clock-offset", "0.05")
    (law,) = given.summary["laws"].values()
    assert law["sensor"] == {"x": 0.1, "y": -0.2, "yaw": 0.3}
    assert law["clock_offset"] == 0.05
    assert "0.100 m ahead of and 0.200 m right of the turning centre, turned by 17.19° (given)" in given.printed


def test_names_of_drives_become_names_of_files(trackslip, tmp_path):
    log = drive_log(6, 8.0, EXACT, STILL)
    write_parquet([replace(log, run=name) for name in ("../a b", "a_b", "é")], tmp_path / "log.parquet")
    result = trackslip("evaluate", str(tmp_path / "log.parquet"), *OPTIONS, "--out", str(tmp_path / "out"))
    names = sorted(file.name for file in (result.folder / "trajectories").iterdir())
    expected = [f"{name}_{what}.tum" for name in ("a_b", "a_b_2", "é") for what in ("measured", "none")]
    assert names == sorted(expected)
    assert np.isfinite(np.loadtxt(result.folder / "trajectories" / names[0])).all()


def test_mistakes_are_told_in_a_line(refused, files, folder):
    log = str(files / "two.parquet")
    (files / "samples.csv").write_text("omega_l,omega_r,v,w\n" + "".join(f"{5 + k},5,0.3,0.1\n" for k in range(3)))
    for arguments, message in (
        ((log,), "half_gauge = None: must be given (--half-gauge on the command line)"),
        ((log, "--law", "icr"), "law = 'icr': must be none, or a folder or file with laws, and :NAME for one of none,"),
        ((log, "--law", "x" * 300), ": must be none, or a folder or file with laws"),
        ((log, "--law", f"{folder}:power"), "; power was retired in trackslip 0.2: see icr_radius"),
        ((log, "--law", folder, "--half-gauge", "0.2"), "its laws are for half_gauge = 0.168 m"),
        ((log, "--sensor", "0", "0", "9", *OPTIONS), "sensor = 9.0: must be from -3.14159 to 3.14159 rad"),
        ((str(files / "no_poses.parquet"), *OPTIONS), "encoders were read at 0 of 0 measured poses"),
        ((str(files / "samples.csv"), *OPTIONS), "holds steady samples; odometry needs drives with times and poses"),
        *(
            ((path, "--law", folder, *OPTIONS, "--out", out), f"out = {out!r}: must be another folder than those of")
            for path, out in ((log, folder), (f"{folder}/runs.parquet", folder))
        ),
    ):
        assert message in refused("evaluate", *arguments), arguments


def test_the_best_law_comes_once_more_with_the_logs_gyro(trackslip, files, tmp_path):
    log = drive_log(6, 60.0, EXACT, LASTING)
    rate = np.append(0.0, np.diff(np.unwrap(log.truth.pose[:, 2])) / np.diff(log.time))
    write_parquet([replace(log, gyro=rate + 0.002)], tmp_path / "gyro.parquet")
    true = f"{files / 'true.json'}:icr_radius"
    result = trackslip("evaluate", str(tmp_path / "gyro.parquet"), "--law", "none", "--law", true)
    laws = result.summary["laws"]
    assert list(laws) == ["none", "icr_radius", "icr_radius with gyro"]
    without, gyro = (laws[name]["after_seconds"]["5"] for name in ("icr_radius", "icr_radius with gyro"))
    assert gyro["position"]["rms"] < 0.75 * without["position"]["rms"]
    assert gyro["heading"]["rms"] < 0.5 * without["heading"]["rms"]
    assert "icr_radius with gyro" in result.printed
    assert "icr_radius with gyro" in (result.folder / "report.html").read_text()
    assert "icr_radius with gyro" in pyarrow.parquet.read_table(result.folder / "table.parquet")["law"].to_pylist()
