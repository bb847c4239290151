"""Encoders as robots state them: angles, ticks and odometry become mean sprocket speeds."""

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackslip.errors import InvalidValueError, LogError
from trackslip.kinematics import RobotGeometry
from trackslip.logs.angles import continuous, odometry_angles
from trackslip.logs.layout import Layout
from trackslip.logs.table_reader import runs_from_table

GEOMETRY = RobotGeometry(0.2, 0.05)
PER_TURN = 1200
TICKS = Layout(ticks_per_turn=PER_TURN)


def driven(seed=0, rows=400, interval=0.05):
    """Times (T,) and angles (T, 2) of sprockets that reverse now and then."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.5, 1.5, rows) * interval)
    phase = rng.uniform(0, 6, 2)
    speeds = 6 * np.sin(time[:, None] / [2.0, 3.1] + phase) + 2
    steps = speeds * np.gradient(time)[:, None]
    return time, np.cumsum(steps, axis=0)


def ticks_of(angle):
    return np.floor(angle / (2 * np.pi) * PER_TURN)


def read(columns, layout):
    """The only run in a table with these columns."""
    (run,) = runs_from_table(pa.table(columns), "log.csv", layout=layout).runs
    return run


def sides(kind, values):
    """Columns of the left and right sprocket."""
    return {f"{kind}_l": values[:, 0], f"{kind}_r": values[:, 1]}


def with_poses(time, **encoders):
    """A table with a pose in each row."""
    return {"t": time, **encoders, "x": np.sin(time), "y": np.cos(time), "phi": time / 10}


def turned(run):
    """Angles (2,) that the sprockets of a run turn by."""
    return np.diff(run.time) @ run.omega[1:]


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), rate=st.floats(5, 120), shift=st.floats(0, 0.1))
def test_angles_turned_are_conserved_beside_rows_of_poses(seed, rate, shift):
    """Whatever the rates of encoders and poses, each in rows of its own."""
    time, angle = driven(seed)
    posed = np.arange(time[0] + shift, time[-1], 1 / rate)
    no_angle = np.full((len(posed), 2), np.nan)
    no_place = np.full(len(time), np.nan)
    columns = {
        "t": np.concatenate([time, posed]),
        **sides("angle", np.concatenate([angle, no_angle])),
        "x": np.concatenate([no_place, np.sin(posed)]),
        "y": np.concatenate([no_place, np.cos(posed)]),
    }
    run = read(columns, Layout())
    np.testing.assert_allclose(turned(run), angle[-1] - angle[0], atol=1e-9)
    assert run.time[0] == time[0]
    assert run.time[-1] == time[-1]


def test_sides_read_at_different_times_keep_their_angles():
    """Left sides in even rows, right ones in odd rows; between them, angles are interpolated."""
    time, angle = driven()
    is_even = np.arange(len(time)) % 2 == 0
    left = np.where(is_even, angle[:, 0], np.nan)
    right = np.where(is_even, np.nan, angle[:, 1])
    run = read(with_poses(time, angle_l=left, angle_r=right), Layout())
    ends = [run.time[0], run.time[-1]]
    begin_left, end_left = np.interp(ends, time[::2], angle[::2, 0])
    begin_right, end_right = np.interp(ends, time[1::2], angle[1::2, 1])
    left_turned, right_turned = turned(run)
    assert left_turned == pytest.approx(end_left - begin_left)
    assert right_turned == pytest.approx(end_right - begin_right)


@pytest.mark.parametrize("low", [0.0, -np.pi])
def test_wrapped_angles_are_unwrapped(low):
    time, angle = driven()
    wrapped = (angle - low) % (2 * np.pi) + low
    run = read(with_poses(time, **sides("angle", wrapped)), Layout())
    np.testing.assert_allclose(turned(run), angle[-1] - angle[0], atol=1e-9)


@pytest.mark.parametrize("size", [256, 1024, PER_TURN, 4096, 10_000, 2**15, 2**16, 2**32])
@pytest.mark.parametrize("signed", [False, True])
def test_counters_of_any_size_are_unwound(size, signed):
    time, angle = driven(rows=1500)
    ticks = ticks_of(angle) + 0.9 * size
    low = -size / 2 if signed else 0.0
    wrapped = (ticks - low) % size + low
    assert np.ptp(wrapped) > 0.8 * size or size > 2**14
    run = read(with_poses(time, **sides("ticks", wrapped)), TICKS)
    exact = 2 * np.pi / PER_TURN * (ticks[-1] - ticks[0])
    np.testing.assert_allclose(turned(run), exact, atol=1e-9)


@pytest.mark.parametrize("per_turn", [1, 4, 12, 20])
def test_coarse_counters_are_left_as_they_are(per_turn):
    time, angle = driven()
    ticks = np.floor(angle[:, 0] / (2 * np.pi) * per_turn)
    counts, restart = continuous(time, ticks, (per_turn, 256, 65536))
    assert restart is None
    np.testing.assert_array_equal(counts, ticks)


def test_a_counter_that_restarts_at_rest_is_noticed():
    time = 0.05 * np.arange(600)
    speed = np.where((time > 10.0) & (time < 20.0), 0.0, 300.0)  # [ticks/s]
    ticks = np.floor(np.cumsum(speed * 0.05))
    ticks[300:] -= ticks[300]
    _, restart = continuous(time, ticks)
    assert restart == 300


def test_a_counter_that_restarts_is_refused_with_its_row():
    time, angle = driven(rows=1500)
    ticks = ticks_of(angle)
    ticks[700:] -= ticks[700]
    said = r"row 701, column ticks_l: jumps from \d+ to 0, .*did the counter restart\? Cut the log"
    with pytest.raises(LogError, match=said):
        read(with_poses(time, **sides("ticks", ticks)), TICKS)


def odometry(angle, geometry=GEOMETRY):
    """Poses (T, 3) that odometry computes on arcs, and the twists' steps (T, 2)."""
    steps = np.diff(angle, axis=0, prepend=angle[:1])
    left, right = steps.T * geometry.sprocket_radius
    distance = (left + right) / 2
    turn = (right - left) / (2 * geometry.half_gauge)
    heading = np.cumsum(turn)
    chord = distance * np.sinc(turn / (2 * np.pi))
    direction = heading - turn / 2
    x = np.cumsum(chord * np.cos(direction))
    y = np.cumsum(chord * np.sin(direction))
    return np.column_stack([x, y, heading]), np.column_stack([distance, turn])


def test_odometrys_poses_give_the_angles_back():
    _, angle = driven()
    pose, _ = odometry(angle)
    np.testing.assert_allclose(odometry_angles(pose, GEOMETRY), angle - angle[0], atol=1e-9)


def test_rounded_odometry_gives_the_angles_back():
    """Most steps are no longer than the unit of a centimetre, and are rounded aside, too."""
    _, angle = driven()
    pose, _ = odometry(angle)
    rounded = np.column_stack([pose[:, :2].round(2), pose[:, 2]])
    moved = GEOMETRY.sprocket_radius * odometry_angles(rounded, GEOMETRY)[-1]
    expected = GEOMETRY.sprocket_radius * (angle[-1] - angle[0])
    np.testing.assert_allclose(moved, expected, atol=0.02)


@pytest.mark.parametrize("layout", [Layout(odometry=GEOMETRY), Layout(robot=GEOMETRY)])
def test_odometry_in_a_table_replaces_encoders(layout):
    time, angle = driven()
    pose, step = odometry(angle)
    heading = (pose[:, 2] + np.pi) % (2 * np.pi) - np.pi
    of_poses = with_poses(time, odom_x=pose[:, 0], odom_y=pose[:, 1], odom_phi=heading)
    run = read(of_poses, layout)
    np.testing.assert_allclose(turned(run), angle[-1] - angle[0], atol=1e-9)
    assert run.metadata["odometry"] == "columns odom_x, odom_y, odom_phi"
    twist = step / np.diff(time, prepend=0.0)[:, None]
    run = read(with_poses(time, odom_v=twist[:, 0], odom_w=twist[:, 1]), layout)
    np.testing.assert_allclose(turned(run), angle[-1] - angle[0], atol=1e-9)


def test_odometry_that_is_reset_is_refused():
    time, angle = driven()
    pose, _ = odometry(angle)
    pose[200:] -= pose[200]
    table = with_poses(time, odom_x=pose[:, 0], odom_y=pose[:, 1], odom_phi=pose[:, 2])
    with pytest.raises(LogError, match=r"row 201, columns odom_x, odom_y: jump by .* reset\?"):
        read(table, Layout(odometry=GEOMETRY))


TIME = np.arange(5) / 10
ONE = np.ones(5)


@pytest.mark.parametrize(
    ("columns", "layout", "said"),
    [
        (("omega_l", "omega_r", "ticks_l"), TICKS, "are 2 kinds of encoder readings: keep one"),
        (("ticks_l",), TICKS, "has no column ticks_r beside ticks_l"),
        (("odom_x", "odom_phi"), Layout(odometry=GEOMETRY), "has no column odom_y beside odom_x"),
        (("ticks_l", "ticks_r"), Layout(), r"ticks_per_turn = None: must be given \(--ticks-per"),
        (("omega_l", "omega_r"), TICKS, "ticks_per_turn = 1200: must be left out: log.csv has no"),
        (("odom_v", "odom_w"), Layout(), r"odometry = None: must be given \(--odom-half-gauge and"),
        (("omega_l", "omega_r"), Layout(odometry=GEOMETRY), "must be left out: log.csv has no col"),
    ],
)
def test_encoders_that_are_incomplete_or_twofold_are_refused(columns, layout, said):
    table = with_poses(TIME, **dict.fromkeys(columns, ONE))
    with pytest.raises((LogError, InvalidValueError), match=said) as refused:
        read(table, layout)
    assert "\n" not in str(refused.value)
