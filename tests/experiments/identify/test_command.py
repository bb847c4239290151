from dataclasses import replace

import numpy as np
import pytest
from plain_drives import wandered

from trackslip.identification.identify import identify
from trackslip.kinematics import RobotGeometry
from trackslip.laws.icr import ConstantIcr
from trackslip.views.values import multiplier_values

ROBOT = RobotGeometry(half_gauge=0.3, sprocket_radius=0.08)
ICR = ConstantIcr(0.09, 0.3, 0.015)
OF_ROBOT = ("--half-gauge", "0.3", "--sprocket-radius", "0.08")
OF_DRIVES = ("--half-gauge", "0.168", "--sprocket-radius", "0.06")
COLUMNS = ("run", "t", "omega_l", "omega_r", "x", "y", "phi")
TWISTS = tuple((v, v / r) for r in (0.8, 1.5, 3.0, -1.0, -2.0) for v in (0.3, 0.6))


def written(runs, path, columns=COLUMNS):
    rows = [",".join(map(str, row)) for run in runs for row in run]
    path.write_text("\n".join([",".join(columns), *rows]))
    return str(path)


def written_drive(log, path, columns=COLUMNS):
    count = len(columns) - 4
    rows = []
    for k, valid in enumerate(log.is_valid):
        pose = log.pose[k, :count] if valid else [""] * count
        rows.append([log.run, log.time[k], *log.omega[k], *pose])
    return written([rows], path, columns)


def test_steady_samples_with_encoders_before_a_gear(trackslip, tmp_path):
    twist = np.array([*TWISTS, (-0.3, 0.2), (0.0, 0.6)])
    noise = np.random.default_rng(0).normal(0, 0.01, twist.shape)
    omega = ICR.sprocket_speeds(twist, ROBOT) + noise
    samples = np.column_stack([30 * omega, twist])
    file = written([samples], tmp_path / "samples.csv", ("omega_l", "omega_r", "v", "w"))
    result = trackslip("identify", file, *OF_ROBOT, "--gear", "30")
    values = result.summary["laws"]["icr_radius"]["values"]
    assert values["offset"] == pytest.approx(0.09, abs=0.01)
    assert result.summary["best"] == "icr_radius"
    assert result.summary["samples"] == 12
    assert (result.folder / "runs.parquet").is_file()


# whole drives


@pytest.fixture
def few_laws(monkeypatch):
    monkeypatch.setattr(
        "trackslip.identification.drive_comparison.drive_laws", lambda: ("none", "icr_radius")
    )


@pytest.mark.usefixtures("few_laws")
def test_a_drive_is_chosen_by_itself(trackslip, refused, tmp_path):
    log = written_drive(wandered(duration=70.0), tmp_path / "log.csv")
    result = trackslip("identify", log, *OF_DRIVES)
    assert result.summary["method"] == "drive"
    assert set(result.summary["prediction"]["none"]) == {"1", "2", "5", "10"}
    assert result.summary["slip_laws"]["icr_radius"]["values"]["offset"] == pytest.approx(
        0.045, abs=0.002
    )
    assert set(result.summary["answer"]) == {
        *(
            "wheel_separation_multiplier",
            "left_wheel_radius_multiplier",
            "right_wheel_radius_multiplier",
        ),
        *("offset", "radius_error"),
    }
    times = result.summary["answer"]["wheel_separation_multiplier"]
    assert times["low"] < times["value"] < times["high"]
    assert times["value"] == pytest.approx(1 + 0.045 / 0.168, abs=0.01)
    assert {alarm["kind"] for alarm in result.summary["alarms"]} <= {"little"}
    assert (result.folder / "runs.parquet").is_file()
    assert "steady" in refused("identify", log, *OF_DRIVES, "--method", "steady")


def test_the_grid_of_the_readme_is_fitted_without_a_warning(trackslip):
    grid = trackslip(
        "grid", "--radii", "0.5", "1", "2", "--speeds", "0.1", "0.2", "--duration", "12"
    ).folder
    found = identify(grid)
    assert found.warnings == ()
    steady = found.comparison.laws["icr_radius"].values
    whole = found.drive.laws["icr_radius"].values
    assert whole["offset"] == pytest.approx(steady["offset"], abs=2e-4)


@pytest.mark.usefixtures("few_laws")
def test_odometry_as_encoders_needs_its_multiplier(trackslip):
    """Odometry of a controller with multiplier 1.2: its wheels' difference is 1 / 1.2 of the true
    one.
    """
    log = wandered(duration=70.0)
    mean = log.omega.mean(axis=1, keepdims=True)
    bag = {"bag": {"encoders": "/odom", "odometry": True}}
    log = replace(log, omega=mean + (log.omega - mean) / 1.2, metadata=bag)
    geometry = RobotGeometry(0.168, 0.06)
    right = 1 + 0.045 / 0.168
    found = identify(log, geometry, method="drive", multiplier=1.2)
    name = "wheel_separation_multiplier"
    assert found.answer[name].value == pytest.approx(right, abs=0.01)
    assert found.alarms == ()
    assert dict(multiplier_values(found))[name].startswith("1.2")
    found = identify(log, geometry, method="drive")
    assert dict(multiplier_values(found))[name].startswith("current × 1.0")
    (alarm,) = found.alarms
    assert alarm.kind == "multiplier"
    assert alarm.line == (
        "the odometry in /odom was computed with a wheel_separation_multiplier that the log does "
        "not state: give --multiplier "
        f"(1 if it had none); the answer is then current × {right / 1.2:.2f}"
    )
