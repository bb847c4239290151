import numpy as np
import pytest

from sim.drive import Drive, DriveState
from trackslip.errors import InvalidValueError

FREE = np.zeros((1, 2))


def test_speed_and_angle_follow_a_first_order_lag_exactly():
    drive = Drive()
    state = DriveState(drive, 1, 0.06)
    state.command(np.array([[2.0, -1.0]]))
    for _ in range(20):
        state.advance(FREE)
    time = 20 * drive.period
    grown = 1 - np.exp(-time / drive.lag)
    np.testing.assert_allclose(state.omega, [[2.0 * grown, -grown]], rtol=1e-12)
    np.testing.assert_allclose(state.angle[0, 0], 2.0 * (time - drive.lag * grown), rtol=1e-12)


def test_top_speed_is_at_the_track():
    state = DriveState(Drive(), 1, 0.06)
    state.command(np.array([[100.0, -100.0]]))
    for _ in range(200):
        state.advance(FREE)
    np.testing.assert_allclose(state.omega * 0.06, [[0.3, -0.3]])


def test_torque_limit_bounds_the_acceleration_and_stalls_under_load():
    drive = Drive(torque_limit=0.2)
    state = DriveState(drive, 1, 0.06)
    state.command(np.array([[4.0, 4.0]]))
    state.advance(FREE)
    assert np.all(np.abs(state.torque) <= 0.2)
    np.testing.assert_allclose(state.omega, 0.2 / drive.inertia * drive.period)
    for _ in range(5):
        state.advance(np.full((1, 2), 0.4 / 0.06))  # twice what the drive can hold
    assert np.all(state.omega < 0)


def test_encoder_counts():
    state = DriveState(Drive(encoder_counts=100), 1, 0.06)
    state.angle[:] = [[2 * np.pi * 0.519, -2 * np.pi * 0.001]]
    np.testing.assert_allclose(state.encoder_angle() / (2 * np.pi), [[0.51, -0.01]])


@pytest.mark.parametrize("field", ["lag", "top_speed", "torque_limit", "inertia", "encoder_counts", "period"])
def test_impossible_drives_are_refused(field):
    with pytest.raises(InvalidValueError, match=field):
        Drive(**{field: -1})


def test_set_points_must_be_finite():
    with pytest.raises(InvalidValueError, match="omega"):
        DriveState(Drive(), 1, 0.06).command(np.array([[np.nan, 1.0]]))
