"""`trackslip identify` on logs of any driving: what it prints and stores, and what it refuses."""

import numpy as np
import pytest
from wandered import GEOMETRY, LAW, wandered

from trackslip.kinematics import advance

LAWS = ("none", "icr_radius")
DURATION = 24.0  # of which the second half can be predicted 10 s ahead [s]
OPTIONS = ("--half-gauge", "0.168", "--sprocket-radius", "0.06")


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """Fit few laws."""
    monkeypatch.setattr("trackslip.identification.identify.DRIVE_LAWS", LAWS)


def written(path, *logs, phi=True):
    """A CSV file with empty cells where nothing was measured."""
    names = ["x", "y", "phi"][: 3 if phi else 2]
    rows = [",".join(["run", "t", "omega_l", "omega_r", *names])]
    for log in logs:
        for k in range(len(log.time)):
            cells = [f"{value:.6f}" if log.is_valid[k] else "" for value in log.pose[k, : len(names)]]
            rows.append(",".join([log.run, f"{log.time[k]:.3f}", *(f"{w:.6f}" for w in log.omega[k]), *cells]))
    path.write_text("\n".join(rows))
    return str(path)


def circles():
    """A CSV file's rows of steady circles to both sides."""
    rows = ["run,t,omega_l,omega_r,x,y,phi"]
    rng = np.random.default_rng(0)
    for radius in (0.6, -1.0, 1.5, -2.5):
        twist = np.array([0.2, 0.2 / radius])
        time = np.arange(0, 12, 0.1)
        pose = advance([0.0, 0.0, 0.0], twist, time) + 0.002 * rng.standard_normal((len(time), 3))
        omega = LAW.sprocket_speeds(twist, GEOMETRY)
        rows += [
            ",".join([f"R {radius}", *(f"{value:.6f}" for value in (t, *omega, *p))])
            for t, p in zip(time, pose, strict=True)
        ]
    return "\n".join(rows)


def test_a_drive_is_chosen_by_itself(trackslip, tmp_path):
    result = trackslip("identify", written(tmp_path / "log.csv", wandered(duration=DURATION)), *OPTIONS)
    assert result.summary["method"] == "drive"
    assert set(result.summary["prediction"]) == set(LAWS)
    assert set(result.summary["prediction"]["none"]) == {"1", "2", "5", "10"}
    assert result.summary["slip_laws"]["icr_radius"]["values"]["offset"] == pytest.approx(0.045, abs=0.002)
    lines = result.printed.splitlines()
    for title in (
        "Slip laws from a whole drive",
        "Sensor and clock, by the best law",
        "Held-out prediction of position, rms | median [m]",
        "Held-out prediction of heading, rms | median [deg]",
    ):
        assert any(line.strip() == title for line in lines), title
    assert sum("no slip compensation" in line for line in lines) == 2
    held = result.summary["drive"]["laws"][result.summary["best"]]["held"]
    assert f"held: T (lag), {held['lag']}" in lines
    assert f"best: {result.summary['best']}," in result.printed
    page = (result.folder / "report.html").read_text(encoding="utf-8")
    assert "Whole drives" in page
    assert (result.folder / "runs.parquet").is_file()


def test_poses_without_headings(trackslip, tmp_path):
    log = written(tmp_path / "log.csv", wandered(headings=False, duration=DURATION), phi=False)
    result = trackslip("identify", log, *OPTIONS)
    assert result.summary["prediction"]["icr_radius"]["2"]["heading_rms"] is None
    assert "prediction of heading" not in result.printed
    assert "held: ψ (sensor_yaw), no headings were measured" in result.printed


def test_a_sensor_that_is_given_is_held(trackslip, tmp_path):
    log = written(tmp_path / "log.csv", wandered(duration=DURATION))
    result = trackslip("identify", log, *OPTIONS, "--method", "drive", "--sensor", "0.0", "-0.001", "0.002")
    law = result.summary["drive"]["laws"]["icr_radius"]
    assert law["held"]["sensor_y"] == law["held"]["sensor_yaw"] == "given"
    assert law["extras"]["sensor_y"] == -0.001
    assert "held: Y (sensor_y), given" in result.printed


@pytest.mark.usefixtures("few_resamples")
def test_steady_driving_has_the_drives_laws_beside_it(trackslip, tmp_path):
    (tmp_path / "log.csv").write_text(circles())
    result = trackslip("identify", str(tmp_path / "log.csv"), *OPTIONS)
    assert result.summary["method"] == "steady"
    assert "Slip laws from 4 steady samples" in result.printed
    assert "Laws compared, the best first" in result.printed
    assert "Slip laws from 4 whole drives" in result.printed
    assert "Sensor and clock" not in result.printed
    drive = result.summary["drive"]["laws"]["icr_radius"]["values"]["offset"]
    assert drive == pytest.approx(result.summary["slip_laws"]["icr_radius"]["values"]["offset"], abs=0.003)


@pytest.mark.usefixtures("few_resamples")
def test_steady_alone(trackslip, tmp_path):
    (tmp_path / "log.csv").write_text(circles())
    result = trackslip("identify", str(tmp_path / "log.csv"), *OPTIONS, "--method", "steady")
    assert "drive" not in result.summary
    assert "whole drive" not in result.printed


def test_driving_that_is_never_steady_has_no_steady_laws(refused, tmp_path):
    line = refused(
        "identify", written(tmp_path / "log.csv", wandered(duration=DURATION)), *OPTIONS, "--method", "steady"
    )
    assert "steady" in line


def test_samples_are_no_drive(refused, tmp_path):
    (tmp_path / "samples.csv").write_text("omega_l,omega_r,v,w\n2,3,0.14,0.1\n3,2,0.14,-0.1\n3,3,0.18,0.0\n")
    line = refused("identify", str(tmp_path / "samples.csv"), *OPTIONS, "--method", "drive")
    assert "steady samples" in line


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--sensor", "0", "0", "5"), "sensor = 5.0: must be from -3.14159 to 3.14159 rad, counter-clockwise"),
        (("--sensor", "300", "0", "0"), "sensor = 300.0: must be from -100 to 100 m, ahead of the middle"),
        (("--sensor", "0", "nan", "0"), "sensor = nan: must be from -100 to 100 m, left of the middle"),
        (("--sensor", "0", "0", "0", "--estimate-sensor"), "estimate_sensor = True: must be left out where --sensor"),
        (("--method", "drive", "--settle", "2"), "settle = 2.0: must be left out with --method drive"),
        (("--method", "drive", "--motion", "arc"), "motion = 'arc': must be left out with --method drive"),
        (
            ("--method", "drive", "--no-estimate-sensor"),
            "estimate_sensor = False: must be left out with --method drive",
        ),
    ],
)
def test_options_that_contradict_each_other(refused, options, message):
    assert message in refused("identify", "log.csv", *options)
