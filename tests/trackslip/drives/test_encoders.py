import numpy as np
import pyarrow as pa
import pytest
from plain_drives import DRIVE, ENCODER_STEP, HUSKY, POSE, TIME, look

from trackslip.drives.encoders import Encoders, encoders_of
from trackslip.logs.runlog import RunLog
from trackslip.logs.table_reader import runs_from_table


def test_jittered_stamps_beside_poses_make_no_smaller_radius():
    """Counts since the reading before, at 20 Hz, stamped up to 20 ms early or late."""
    rng = np.random.default_rng(3)
    read = np.arange(0.0, 119.0, 0.05)
    stamp = read + 0.03 + rng.uniform(-0.02, 0.02, len(read))
    turned = np.cumsum(DRIVE.omega * ENCODER_STEP, axis=0)
    angle = np.column_stack([np.interp(read, DRIVE.time, side) for side in turned.T])
    omega = np.diff(angle, axis=0) / np.diff(stamp)[:, None]

    time = np.concatenate([stamp[1:], TIME])
    empty = np.full((len(TIME), 2), np.nan), np.full((len(omega), 3), np.nan)
    values = np.column_stack(
        [np.append(omega, empty[0], axis=0), np.append(empty[1], POSE, axis=0)]
    )
    order = np.argsort(time)
    columns = dict(zip(("omega_l", "omega_r", "x", "y", "phi"), values[order].T, strict=True))
    cells = {name: pa.array(column, from_pandas=True) for name, column in columns.items()}
    (log,) = runs_from_table(pa.table({"t": time[order]} | cells), "a table").runs

    speed = look(log).gains.speed.value
    assert speed == pytest.approx(1 + HUSKY.radius_error, abs=0.003)


def log_of(time, omega):
    pose = np.column_stack([time, time, time])
    return RunLog("a", time, np.column_stack([omega, omega]), pose)


def test_values_that_are_held_for_several_rows_become_a_smooth_curve():
    time = 0.05 * np.arange(401)
    held = 3 + np.sin(0.2 * np.ceil(time / 0.2 - 1e-9))
    smooth = encoders_of(log_of(time, held)).smooth()
    middle = (smooth.edges[1:] + smooth.edges[:-1]) / 2
    true = 3 + np.sin(middle + 0.1)
    inside = slice(8, -8)
    assert np.abs(smooth.omega[inside, 0] - true[inside]).max() < 0.02
    assert np.abs(np.interp(middle, time - 0.025, held) - true)[inside].max() > 0.05


@pytest.mark.parametrize(
    "omega",
    [
        np.random.default_rng(0).normal(size=401),
        np.repeat(np.random.default_rng(0).normal(size=8), 51)[:401],
        np.ones(401),
    ],
)
def test_values_of_every_row_and_held_commands_stay_as_they_are(omega):
    time = 0.05 * np.arange(401)
    smooth = encoders_of(log_of(time, omega)).smooth()
    np.testing.assert_array_equal(smooth.edges, time)
    np.testing.assert_allclose(smooth.omega[:, 0], omega[1:], rtol=1e-12)


def test_a_long_standstill_between_held_values_stays_one():
    time = 0.05 * np.arange(801)
    held = 3 + np.sin(0.2 * np.ceil(time / 0.2 - 1e-9))
    held[(time > 15.0) & (time < 25.0)] = 0.0
    smooth = encoders_of(log_of(time, held)).smooth()
    inside = (smooth.edges[:-1] > 15.3) & (smooth.edges[1:] < 24.7)
    assert (np.abs(smooth.omega[inside]) < 1e-12).all()


def test_several_ticks_in_an_interval_are_spread_over_it():
    """A sprocket that stood turns by half a tick at most before it starts, and not by half of all
    ticks.
    """
    time = 0.1 * np.arange(201)
    ticks = np.where(time > 10.0, np.random.default_rng(1).integers(1, 9, 201), 0)
    ticks[np.searchsorted(time, 10.05)] = 8
    encoders = encoders_of(log_of(time, ticks))
    turned = encoders.angles[np.searchsorted(encoders.edges, 10.0), 0]
    assert turned == pytest.approx(0.0, abs=0.5 * 0.1 + 1e-9)


def test_merged_intervals_turn_by_the_same_angle():
    time = np.sort(np.random.default_rng(0).uniform(0, 10, 1000))
    encoders = Encoders(time, np.random.default_rng(1).normal(size=(999, 2)))
    merged = encoders.merged(100)
    assert len(merged.omega) <= 101
    np.testing.assert_allclose(merged.angles[-1], encoders.angles[-1], rtol=1e-9)
    assert merged.edges[-1] == time[-1]
