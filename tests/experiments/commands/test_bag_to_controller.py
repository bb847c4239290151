"""The closed circle: teleoperation in the simulator, bag, identify, deploy, and the odometry of ros2_control."""

import numpy as np
import pytest
from diff_drive import DiffDrive, parameters_in

import trackslip
from experiments.cli import main

LENGTHS = (1.0, 2.0, 5.0)  # driven, after which headings are compared [m]
GAIN = 5.0  # least factor by which heading errors get smaller
GEOMETRY = ("--half-gauge", "0.168", "--sprocket-radius", "0.06")


def heading_errors(controller, log):
    """Rms error of the heading per metre [rad/m] over pieces of LENGTHS of a drive, by the controller's odometry."""
    heading, true = controller.odometry(log.time, log.omega)[:, 2], log.truth.pose
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(true[:, :2], axis=0).T))])
    errors = []
    for length in LENGTHS:
        start = np.flatnonzero(driven + length <= driven[-1])
        end = np.searchsorted(driven, driven[start] + length)
        missed = (heading[end] - heading[start]) - (true[end, 2] - true[start, 2])
        errors.append(np.sqrt(np.mean(missed**2)) / length)
    return np.array(errors)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(9))
def test_odometry_with_deployed_parameters_turns_as_the_robot_does_on_another_drive(
    seed, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    main(["wander", "--drives", "2", "--duration", "60", "--seed", str(seed), "--bag", "--out", "driven"])
    main(["identify", "driven/bags/random_1", *GEOMETRY, "--out", "mine"])
    main(["deploy", "mine", "--to", "ros2_control", "--out", "controller.yaml"])
    parameters = parameters_in((tmp_path / "controller.yaml").read_text())
    ones = parameters | {key: 1.0 for key in parameters if key.endswith("multiplier")}
    (other,) = (log for log in trackslip.load("driven") if log.run == "random 2")
    before, after = (heading_errors(DiffDrive.of(one), other) for one in (ones, parameters))
    with capsys.disabled():
        print(f"\nseed {seed}: heading errors smaller by {np.round(before / after, 1)} after {LENGTHS} m")
    assert (before > GAIN * after).all()
