"""What holds for clean drives of any log."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
from hypothesis import given
from hypothesis import strategies as st

from trackslip.drives.conditioning import drive_of, drives_of
from trackslip.drives.encoders import encoders_of
from trackslip.logs.runlog import RunLog
from trackslip.logs.table_reader import runs_from_table

SECONDS = 12.0
KINDS = ("smooth", "random", "ticks", "held")
RATES = (4, 7, 20, 33, 50, 100)


@st.composite
def stamps(draw, rng, fastest):
    """Times of one sensor [s], at a rate of its own, maybe with jitter."""
    rates = [rate for rate in RATES if rate <= fastest]
    step = 1 / draw(st.sampled_from(rates))
    jitter = draw(st.sampled_from([0.0, 0.4]))
    first = draw(st.sampled_from([0.0, 0.011]))
    time = np.arange(first, SECONDS, step)
    early_or_late = jitter * step * rng.uniform(-1, 1, len(time))
    return np.round(time + early_or_late + 1.0, 5)


def speeds(kind, rng, time):
    """Sprocket speeds (T, 2) of a kind at times."""
    smooth = 3 + np.column_stack([np.sin(time), 2 * np.cos(0.7 * time)])
    if kind == "held":
        return smooth[np.arange(len(time)) // 4 * 4]
    if kind == "ticks":
        return np.round(smooth) * [1.0, -1.0]
    return smooth if kind == "smooth" else rng.normal(size=smooth.shape)


@st.composite
def logs(draw, kinds=KINDS, fastest_poses=100):
    """Logs of encoders and poses at rates of their own: a row is one of either, or of both."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    read = draw(stamps(rng, fastest=100))
    seen = draw(stamps(rng, fastest_poses))
    seen = seen[(seen >= read[0] - 0.5) & (seen <= read[-1])]
    time = np.union1d(read, seen)
    kind = draw(st.sampled_from(kinds))
    next_reading = np.searchsorted(read, time)
    omega = speeds(kind, rng, read)[next_reading]

    heading = -np.cos(time)
    gyro = np.append(0.0, np.diff(heading) / np.diff(time))
    place = rng.normal(size=(len(time), 2)).cumsum(axis=0)
    valid = np.isin(time, seen)
    pose = np.where(valid[:, None], np.column_stack([place, heading]), np.nan)
    return RunLog("a", time, omega, pose, valid=valid, read=np.isin(time, read), gyro=gyro)


def steps(log):
    """Angles (T - 1, 2) that sprockets turn by between the rows of a log [rad]."""
    return log.omega[1:] * np.diff(log.time)[:, None]


def angles(log):
    """Angles (T, 2) turned up to each row of a log [rad]."""
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps(log), axis=0)])


def angles_of(encoders, time):
    """Angles (n, 2) turned up to times (n,) by clean encoders [rad]."""
    left, right = encoders.angles.T
    return np.column_stack(
        [np.interp(time, encoders.edges, left), np.interp(time, encoders.edges, right)]
    )


def table(log, rows):
    """The rows of a log, each with encoders, a pose or both, as a table with empty cells.

    `rows` (n, 2) bool: for each row, whether encoders and pose are in it.
    """
    row = np.flatnonzero(rows.any(axis=1))
    has_encoders, has_pose = rows[row].T
    of_log = row % len(log.time)
    time = log.time[of_log]
    omega = np.where(has_encoders[:, None], log.omega[of_log], np.nan)
    pose = np.where(has_pose[:, None], log.pose[of_log], np.nan)
    names = ("t", "omega_l", "omega_r", "x", "y", "phi")
    order = np.argsort(time, kind="stable")
    columns = {}
    for name, values in zip(names, (time, *omega.T, *pose.T), strict=True):
        columns[name] = pa.array(values[order], from_pandas=True)
    return pa.table(columns)


def drive_in(content):
    (log,) = runs_from_table(content, "a table").runs
    return drive_of(log)


def require_same(one, other):
    for name in ("edges", "omega", "time", "pose"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


@given(logs())
def test_a_sprocket_turns_by_the_angle_in_its_log(log):
    encoders = encoders_of(log).smooth()
    assert encoders.edges[0] == log.time[0]
    assert encoders.edges[-1] == log.time[-1]
    missed = np.abs(encoders.angles[-1] - angles(log)[-1])
    way = np.abs(steps(log)).sum(axis=0)
    assert (missed <= 1e-9 * way).all()


@given(logs(kinds=("smooth", "random")))
def test_a_sprocket_has_the_angle_read_at_each_reading(log):
    read = log.is_read
    found = angles_of(encoders_of(log).smooth(), log.time[read])
    np.testing.assert_allclose(found, angles(log)[read], atol=1e-9)


@given(logs())
def test_a_sprocket_turns_forwards_where_its_log_does(log):
    forwards = replace(log, omega=np.abs(log.omega))
    assert (encoders_of(forwards).smooth().omega >= -1e-9).all()


def started_at(seconds, log):
    """The log of sprockets that stand until the first reading after some time, and that reading's
    time [s].
    """
    readings = log.time[log.is_read]
    start = readings[np.searchsorted(readings, seconds)]
    return replace(log, omega=log.omega * (log.time > start)[:, None]), start


@given(logs(kinds=("smooth", "random", "held")))
def test_a_sprocket_stands_until_it_starts_in_its_log(log):
    late, start = started_at(7.0, log)
    encoders = encoders_of(late).smooth()
    before = encoders.edges[1:] <= start
    assert (np.abs(encoders.omega[before]) < 1e-9).all()


@given(logs(kinds=("ticks",)))
def test_a_standing_sprocket_turns_by_half_a_tick_at_most(log):
    late, start = started_at(7.0, log)
    speeds = np.where(late.omega == 0, np.inf, np.abs(late.omega))
    longest = np.diff(log.time[log.is_read]).max()
    tick = speeds.min(axis=0) * longest
    turned = np.abs(angles_of(encoders_of(late), start))
    assert (turned <= tick / 2 + 1e-9).all()


def cut_both_ways(log, begin, end):
    """The clean drive of a part of a log, and the part of the clean drive of the log."""
    first, last = np.searchsorted(log.time, [begin, end])
    part = log.between(first, last + 1)
    return drive_of(part), drive_of(log).cut(part.time[0], part.time[-1])


CUTS = st.floats(2, 5), st.floats(8, 11)


@given(logs(kinds=("smooth", "random", "held"), fastest_poses=33), *CUTS)
def test_a_cut_log_is_a_cut_drive(log, begin, end):
    of_part, of_whole = cut_both_ways(log, begin, end)
    np.testing.assert_array_equal(of_part.time, of_whole.time)
    np.testing.assert_array_equal(of_part.edges, of_whole.edges)
    for name in ("omega", "pose"):
        np.testing.assert_allclose(getattr(of_part, name), getattr(of_whole, name), atol=1e-9)
    np.testing.assert_array_equal(of_part.gyro[:, 0], of_whole.gyro[:, 0])
    turned = np.diff(of_part.gyro, axis=0)
    np.testing.assert_allclose(turned, np.diff(of_whole.gyro, axis=0), atol=1e-9)


@given(logs(kinds=("smooth", "random"), fastest_poses=33), *CUTS)
def test_away_from_the_cut_a_smooth_log_is_a_smooth_drive(log, begin, end):
    of_part, of_whole = cut_both_ways(log, begin, end)
    away = np.linspace(begin + 0.8, end - 0.8, 50)  # by two readings, beyond which nothing bends
    turned_in_part = np.diff(of_part.smooth().angles(away))
    turned = np.diff(of_whole.smooth().angles(away))
    np.testing.assert_allclose(turned_in_part, turned, atol=1e-9)


@given(logs())
def test_rows_per_sensor_or_joined_give_the_same_drive(log):
    joined = np.column_stack([log.is_read, log.is_valid])
    encoders = joined * [True, False]
    poses = joined * [False, True]
    split = np.concatenate([encoders, poses])
    require_same(drive_in(table(log, split)), drive_in(table(log, joined)))


@given(logs())
def test_arrays_of_each_sensor_give_the_same_drive(log):
    log = log.between(np.argmax(log.is_read), len(log.time))  # poses before are beyond the readings
    read = log.is_read
    seen = log.is_valid
    encoders = log.time[read], *log.omega[read].T
    poses = log.time[seen], *log.pose[seen].T
    of_arrays = drive_of(RunLog.from_arrays(encoders, poses))
    require_same(of_arrays, drive_in(table(log, np.column_stack([read, seen]))))


@given(logs(kinds=("smooth", "random")))
def test_empty_cells_may_be_filled_with_the_next_reading(log):
    filled = np.column_stack([np.ones(len(log.time), bool), log.is_valid])
    empty = np.column_stack([log.is_read, log.is_valid])
    readings = log.time[log.is_read]

    def turned(rows):
        return np.diff(drive_in(table(log, rows)).angles(readings))

    np.testing.assert_allclose(turned(filled), turned(empty), atol=1e-9)


@given(logs())
def test_rows_that_are_logged_twice_count_once(log):
    once = np.column_stack([log.is_read, log.is_valid])
    twice = np.concatenate([once, once])
    require_same(drive_in(table(log, twice)), drive_in(table(log, once)))


@given(logs())
def test_a_log_given_twice_is_one_drive(log):
    drives, refused = drives_of([log, log])
    assert len(drives) == 1
    assert str(refused[0]) == "run 'a' left out: a copy of run 'a'"
