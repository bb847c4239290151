import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from plain_drives import DRIVE, ENCODER_STEP, HUSKY, look, measured

from trackslip.drives.encoders import Encoders, encoders_of
from trackslip.logs.repeats import angle_readings, speed_readings, without_repeats
from trackslip.logs.runlog import RunLog
from trackslip.logs.table_reader import runs_from_table


def jittered(kind="omega", jitter=0.02, pose_step=0.1):
    """Encoders at 20 Hz, stamped up to `jitter` [s] early or late, beside poses: a row for each.

    Speeds are counts since the reading before, divided by the time between the stamps.
    """
    rng = np.random.default_rng(3)
    read = np.arange(0.0, 119.0, 0.05)
    stamp = read + 0.03 + jitter * rng.uniform(-1, 1, len(read))
    turned = np.cumsum(DRIVE.omega * ENCODER_STEP, axis=0)
    angle = np.column_stack([np.interp(read, DRIVE.time, side) for side in turned.T])
    speed = np.diff(angle, axis=0) / np.diff(stamp)[:, None]
    readings = angle[1:] if kind == "angle" else speed
    encoders = pd.DataFrame(readings, stamp[1:], (f"{kind}_l", f"{kind}_r"))
    time, pose = measured(DRIVE, pose_step)
    poses = pd.DataFrame(pose, time, ("x", "y", "phi"))
    return encoders.join(poses, how="outer").rename_axis("t")


def look_in(rows):
    """The first look at a table, and the notes of its reader."""
    table = pa.Table.from_pandas(rows.reset_index(), preserve_index=False)
    read = runs_from_table(table, "a")
    return look(*read.runs), " ".join(read.notes)


TRUE_GAIN = pytest.approx(1 + HUSKY.radius_error, abs=0.003)


def test_jittered_stamps_beside_poses_make_no_smaller_radius():
    found, _ = look_in(jittered())
    assert found.gains.speed.value == TRUE_GAIN


@pytest.mark.parametrize("jitter", [0.02, 0.005])
def test_mean_speeds_filled_forwards_count_once(jitter):
    rows = jittered(jitter=jitter)
    found, notes = look_in(rows.ffill())
    assert found.gains.speed.value == TRUE_GAIN
    assert "each encoder reading is repeated in" in notes
    filled_beside_poses = rows.assign(**rows[["omega_l", "omega_r"]].ffill())
    found, _ = look_in(filled_beside_poses)
    assert found.gains.speed.value == TRUE_GAIN
    assert not found.alarms


def test_a_value_that_lasts_to_the_end_was_read_several_times():
    """Rows count that are a usual interval away from both of its ends."""
    time = np.arange(100.0)
    changes = np.array([0, 2, 4, 6])
    rows = without_repeats(time, changes, usual=2.0)
    np.testing.assert_array_equal(rows, [0, 2, 4, 6, *range(8, 98)])


@pytest.mark.parametrize("fill", ["ffill", "bfill"])
@pytest.mark.parametrize("kind", ["omega", "angle"])
def test_encoders_filled_either_way_keep_the_radius(kind, fill):
    rows = jittered(kind)
    encoders = rows.iloc[:, :2]
    found, _ = look_in(rows.assign(**getattr(encoders, fill)()))
    assert found.gains.speed.value == TRUE_GAIN
    assert not found.alarms


def test_counts_of_unknown_times_are_an_alarm():
    """Only rows with poses are kept, as `merge_asof` does: two readings may be in one of them."""
    rows = jittered(pose_step=ENCODER_STEP).ffill()
    found, _ = look_in(rows[rows.index.isin(DRIVE.time)])
    assert [alarm.kind for alarm in found.alarms] == ["readings"]


def test_short_runs_of_filled_speeds_are_an_alarm():
    rows = jittered().ffill()
    parts = []
    for k, begin in enumerate(range(8, 100, 4)):
        is_part = (rows.index >= begin) & (rows.index < begin + 4)
        parts.append(rows[is_part].assign(run=str(k)))
    table = pa.Table.from_pandas(pd.concat(parts).reset_index(), preserve_index=False)
    read = runs_from_table(table, "a")
    (alarm,) = look(*read.runs).alarms
    assert "each encoder reading is repeated in" in alarm.line


def test_held_speeds_of_a_controller_stay_as_they_are():
    rng = np.random.default_rng(0)
    changes = np.cumsum(rng.integers(2, 6, 700))  # rows
    row = np.arange(changes[-1])
    time = 0.02 * row
    changed = np.append(0, changes)[np.searchsorted(changes, row, side="right")]
    speed = 3 + np.sin(time[changed])
    assert speed_readings(time, np.column_stack([speed, speed])) is None


def test_a_standing_sprocket_was_read_all_the_time():
    time = 0.02 * np.arange(1500)
    read = 0.06 * np.floor(time / 0.06 + 1e-9)
    rests = (read >= 10) & (read < 20)
    driven = np.where(rests, 10.0, np.where(read < 10, read, read - 10))
    angle = 3 * driven + np.sin(driven)
    rows = angle_readings(time, angle[:, None])
    steps = np.diff(time[rows])
    stands = (time[rows[1:]] > 10.1) & (time[rows[1:]] < 19.9)
    assert steps[~stands].max() < 0.09
    assert steps[stands] == pytest.approx(0.02)


TURNED = 5 * np.arange(400) + np.arange(400) ** 2 % 7


@pytest.mark.parametrize("angle", [TURNED % 100, 4_000_000_000 + TURNED])
def test_wrapped_angles_and_large_counts_are_read_once(angle):
    time = 0.02 * np.arange(1200)
    counts = angle[np.arange(1200) // 3].astype(float)
    rows = angle_readings(time, counts[:, None])
    assert list(rows) == [*range(0, 1200, 3)]


def log_of(time, omega):
    pose = np.column_stack([time, time, time])
    return RunLog("a", time, np.column_stack([omega, omega]), pose)


def test_values_held_for_several_rows_become_a_smooth_curve():
    time = 0.05 * np.arange(401)
    held = 3 + np.sin(0.2 * np.ceil(time / 0.2 - 1e-9))
    smooth = encoders_of(log_of(time, held)).smooth()
    middle = (smooth.edges[1:] + smooth.edges[:-1]) / 2
    true = 3 + np.sin(middle + 0.1)
    inside = slice(8, -8)
    smooth_error = np.abs(smooth.omega[:, 0] - true)
    held_error = np.abs(np.interp(middle, time - 0.025, held) - true)
    assert smooth_error[inside].max() < 0.02
    assert held_error[inside].max() > 0.05


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
    start = np.searchsorted(encoders.edges, 10.0)
    half_tick = 0.5 * 0.1
    assert encoders.angles[start, 0] == pytest.approx(0.0, abs=half_tick + 1e-9)


def test_merged_intervals_turn_by_the_same_angle():
    time = np.sort(np.random.default_rng(0).uniform(0, 10, 1000))
    encoders = Encoders(time, np.random.default_rng(1).normal(size=(999, 2)))
    merged = encoders.merged(100)
    assert len(merged.omega) <= 101
    np.testing.assert_allclose(merged.angles[-1], encoders.angles[-1], rtol=1e-9)
    assert merged.edges[-1] == time[-1]
