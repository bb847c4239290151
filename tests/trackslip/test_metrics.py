import numpy as np
import pytest

from trackslip.logs.runlog import RunLog, Truth
from trackslip.metrics import expense, tracking_errors
from trackslip.trajectory.segmented import circle

TIME = np.arange(0, 20.0 + 1e-9, 0.05)


def test_a_constant_offset_is_measured_exactly():
    reference = circle(1.25, 0.15, 20.0)
    desired = reference.pose(TIME)
    heading = desired[:, 2]
    left = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    place = desired[:, :2] + 0.03 * left + 0.04 * ahead
    pose = np.column_stack([place, heading + 0.1 + 2 * np.pi])
    errors = tracking_errors(TIME, pose, reference)
    for value in (
        errors.rms_position,
        errors.rms_position_after_12s,
        errors.max_position,
        errors.final_position,
    ):
        assert value == pytest.approx(0.05)
    assert errors.cross_track == pytest.approx(0.03)
    assert errors.rms_heading == pytest.approx(0.1)
    assert errors.final_heading == pytest.approx(0.1)
    assert errors.success


def test_expense_of_constant_and_of_alternating_set_points():
    rows = len(TIME)
    command = np.tile([3.0, 4.0], (rows, 1))
    saturated = np.zeros((rows, 2))
    saturated[1:21, 0] = 0.5  # one second, half of it

    def spent(command):
        zero = np.zeros((rows, 2))
        still = np.zeros((rows, 3))
        truth = Truth(still, still, zero, zero, saturated=saturated)
        log = RunLog("run", TIME, zero, still, command=command, truth=truth)
        return expense(log, 5.0)

    assert spent(command).effort == pytest.approx(12.5 * 20)
    assert spent(command).roughness == 0.0
    assert spent(command).saturation_s == pytest.approx(0.5)
    command[:, 1] += np.where(np.arange(rows) % 2, 0.1, -0.1)
    assert spent(command).roughness == pytest.approx(0.2 / 0.05 / np.sqrt(2))
    command[40:60, 1] = 5.0
    assert spent(command).saturation_s == pytest.approx(1.5)
