import numpy as np
import pytest
from bags import (
    START,
    fix,
    header,
    in_order,
    joint_states,
    joints_of,
    odometry,
    pose_stamped,
    poses_of,
    sprocket_angles,
    stamp,
    transform,
    write_bag,
)
from plain_drives import GEOMETRY, wandered

import trackslip
from trackslip import se2
from trackslip.bags.choice import BagChoice
from trackslip.bags.drives import read_bags
from trackslip.errors import LogError
from trackslip.kinematics import body_twist

LOG = wandered(duration=11.0)
TURNED = sprocket_angles(LOG)
WHEELS = (
    "front_left_wheel_joint",
    "front_right_wheel_joint",
    "rear_left_wheel_joint",
    "rear_right_wheel_joint",
)
FOUR = TURNED[:, [0, 1, 0, 1]]
ROWS = range(len(LOG.time))
SEEN = LOG.is_valid


def states(angles=FOUR, names=WHEELS, velocity=(), effort=(), rows=ROWS, unstamped=(), **others):
    """Joint states of `rows`, with velocities and efforts that are the same in all of them."""
    messages = []
    for k in rows:
        message = joint_states(stamp(LOG.time[k]), names, angles[k].tolist(), velocity, **others)
        message[3]["effort"] = list(effort)
        if k in unstamped:
            message[3]["header"] = header(0)
        messages.append(message)
    return messages


def dead_reckoned(half_gauge=GEOMETRY.half_gauge, arcs=True):
    """Poses at LOG's times by the wheels alone, on arcs or straight ahead at the end of each
    step.
    """
    geometry = trackslip.RobotGeometry(half_gauge, GEOMETRY.sprocket_radius)
    twist = body_twist(LOG.omega[1:], 0.0, geometry)
    step = np.diff(LOG.time)
    pose = se2.chain([0.0, 0.0, 0.4], se2.advance(np.zeros(3), twist, step))
    if not arcs:
        distance = twist[:, 0] * step
        ahead = distance[:, None] * se2.direction(pose[1:, 2])
        pose[1:, :2] = np.cumsum(ahead, axis=0)
    return pose


def stated(poses, make=odometry, **others):
    return [
        make(stamp(time), where, **others)
        for time, where in zip(LOG.time, poses.tolist(), strict=True)
    ]


def fixes(early, status=0):
    """Fixes at LOG's poses, the first 20 of them at another place, with another status."""
    messages = []
    for k, (time, (x, y, _)) in enumerate(zip(LOG.time[SEEN], LOG.pose[SEEN], strict=True)):
        if k < 20:
            messages.append(fix(stamp(time), *early, status=status))
        else:
            latitude = 48.0 + y / 111_195
            longitude = 11.0 + x / 74_500
            messages.append(fix(stamp(time), latitude, longitude, status=0))
    return messages


def later(messages, seconds=40.0):
    delay = round(1e9 * seconds)
    return [(topic, kind, at + delay, fields) for topic, kind, at, fields in messages]


def write(tmp_path, *messages, name="run", kind="mcap"):
    return write_bag(tmp_path / name, kind, in_order(*messages))


def assert_driven(log, atol=1e-9):
    offset = log.metadata["bag"]["start"] - START / 1e9
    rows = np.searchsorted(LOG.time, log.time + offset - 1e-4)
    assert len(rows) > 0.9 * len(LOG.time)
    np.testing.assert_allclose(log.omega[1:], LOG.omega[rows[1:]], atol=atol)


def test_rows_are_those_of_readings_and_poses(tmp_path):
    """Poses 13 ms after every other reading: rows of their own, with the speeds of the reading
    after them.
    """
    late = []
    for time, where in zip(LOG.time[SEEN], LOG.pose[SEEN].tolist(), strict=True):
        late.append(pose_stamped(stamp(time + 0.013), where))
    (log,) = trackslip.load(write(tmp_path, joints_of(LOG), late))
    assert log.run == "run"
    assert log.metadata["bag"] == {
        "encoders": "/joint_states",
        "left": ["left_wheel"],
        "right": ["right_wheel"],
        "poses": "/slam/pose",
        "start": START / 1e9,
    }
    seen = np.flatnonzero(log.is_valid)
    np.testing.assert_allclose(log.time[seen], LOG.time[SEEN] + 0.013, atol=1e-9)
    np.testing.assert_allclose(log.pose[seen], LOG.pose[SEEN], atol=1e-9)
    readings = np.flatnonzero(~log.is_valid)
    nanoseconds = np.round(log.time[readings] * 1e9)
    np.testing.assert_array_equal(nanoseconds, np.round(LOG.time * 1e9))
    np.testing.assert_allclose(log.omega[readings[1:]], LOG.omega[1:], atol=1e-9)
    np.testing.assert_array_equal(log.omega[seen], log.omega[seen + 1])
    assert np.isnan(log.pose[readings]).all()


REPEATED = "/odom: its poses repeat the dead reckoning of the wheels: they say nothing about slip"
NO_FIX = "topic /fix: 20 of 110 messages left out: they have no fix"


@pytest.mark.parametrize(
    ("messages", "choice", "notes"),
    [
        ([states(velocity=[0.0] * 4, effort=[np.nan] * 4), poses_of(LOG)], {}, []),
        ([states(), poses_of(LOG, odometry)], {}, []),  # measured, not from the wheels
        ([states(FOUR * [-1, 1, -1, 1]), poses_of(LOG)], {"reversed": "left"}, []),
        ([states(), stated(dead_reckoned())], {"poses": "/odom"}, [REPEATED]),
        ([states(), stated(dead_reckoned())], {"dead_reckoned": True}, [REPEATED]),
        (
            [states(), poses_of(LOG, start=START - 3 * 10**9, late=3 * 10**9)],
            {},
            ["clocks differ by 3.0 s by their receive"],
        ),
        (
            [states(FOUR * [1, 0, 1, 1]), poses_of(LOG)],
            {},
            [f"{WHEELS[1]} left out: it stands still"],
        ),
        ([states(), states(), poses_of(LOG), poses_of(LOG)], {}, ["time is stamped twice"] * 2),
        ([states(), fixes((0.0, 0.0))], {}, [NO_FIX]),
        ([states(), fixes((np.nan, np.nan), status=-1)], {}, [NO_FIX]),
    ],
)
def test_sprockets_are_read_and_quirks_are_told(tmp_path, messages, choice, notes):
    read = read_bags(write(tmp_path, *messages), BagChoice(**choice))
    assert_driven(*read.runs)
    assert len(read.warnings) == len(notes)
    assert all(note in line for note, line in zip(notes, read.warnings, strict=True))


def test_readings_stamped_in_bursts_make_no_wild_speeds(tmp_path):
    """Every tenth reading waits and is stamped 4 µs before the next one."""
    time = LOG.time.copy()
    time[10:-1:10] = time[11::10] - 4e-6
    bursts = []
    for at, angle in zip(time.tolist(), TURNED.tolist(), strict=True):
        bursts.append(joint_states(stamp(at), ("left", "right"), angle))
    (log,) = read_bags(write(tmp_path, bursts, poses_of(LOG))).runs
    assert np.abs(log.omega).max() <= np.abs(LOG.omega).max() + 1e-6
    turned = sprocket_angles(log)[-1]
    np.testing.assert_allclose(turned, TURNED[-1] - TURNED[0], atol=0.2)


STILL = transform(START, "map", "odom", (0.0, 0.0, 0.0), topic="/tf_static")


def as_transform(at, where):
    return transform(at, "odom", "base_link", where)


def stamped_late(at, where):
    """Odometry with stamps 30 ms late."""
    return odometry(at + 30_000_000, where)


PASSED_ON = [STILL, *stated(dead_reckoned(), as_transform)]


@pytest.mark.parametrize(
    ("messages", "line"),
    [
        ([states(), stated(dead_reckoned())], REPEATED),
        ([states(), stated(dead_reckoned(arcs=False))], REPEATED),
        ([states(), stated(dead_reckoned(), stamped_late)], REPEATED),
        (
            [states(), PASSED_ON],
            "tf:map:base_link: its poses repeat the dead reckoning of the wheels",
        ),
        (
            [states(FOUR * [1, 1, 1, -1]), poses_of(LOG)],
            "of one side turn against each other: choose with --left",
        ),
        (
            [states(), poses_of(LOG, start=0, late=START)],
            "s: different clocks, simulated and wall time",
        ),
        (
            [states(), poses_of(LOG, start=START - 10**11, late=10**11)],
            "s: clocks differ by 100.0 s by their receive",
        ),
    ],
)
def test_what_makes_no_log_is_refused(tmp_path, messages, line):
    with pytest.raises(LogError, match=line):
        read_bags(write(tmp_path, *messages))


def test_controllers_that_publish_their_own_joints_on_one_topic(tmp_path):
    """The front wheels in one message, the rear wheels in the next, an arm in between."""
    front = states(FOUR[:, :2], WHEELS[:2], rows=ROWS[::2])
    rear = states(FOUR[:, 2:], WHEELS[2:], rows=ROWS[1::2])
    arm = states(np.zeros((len(FOUR), 1)), ("arm_1",), rows=ROWS[::7], late=2_000_000)
    read = read_bags(write(tmp_path, front, rear, arm, poses_of(LOG)))
    (log,) = read.runs
    time = log.time + log.metadata["bag"]["start"] - START / 1e9
    real = np.column_stack([np.interp(time, LOG.time, side) for side in TURNED.T])
    np.testing.assert_allclose(sprocket_angles(log), real - real[0], atol=0.02)
    assert read.warnings == ()


def test_a_simulation_that_was_reset_makes_two_drives(tmp_path):
    once = [*states(), *poses_of(LOG)]
    read = read_bags(write(tmp_path, once, later(once)))
    assert [log.run for log in read.runs] == ["run, part 1", "run, part 2"]
    for log in read.runs:
        assert_driven(log)
    without_poses = later(states())
    read = read_bags(write(tmp_path / "half", states(), poses_of(LOG), without_poses))
    assert_driven(*read.runs)
    assert read.warnings == (
        "topic /joint_states: time goes back: read as 2 drives",
        "run 'run, part 2' left out: topic /slam/pose: no messages",
    )


def set_ahead(messages, rise):
    """The messages with stamps that are `rise` [ns] later, recorded 40 s later."""
    made = []
    for topic, kind, at, fields in messages:
        old = fields["header"]
        old_stamp = old["stamp"]["sec"] * 10**9 + old["stamp"]["nanosec"]
        new = header(old_stamp + rise, old["frame_id"])
        made.append((topic, kind, at, fields | {"header": new}))
    return later(made)


@pytest.mark.parametrize("rise", [40 * 10**9, 4 * 10**17], ids=["a pause", "a clock that is set"])
def test_a_bag_is_cut_at_gaps_of_its_encoders(tmp_path, rise):
    once = [*states(), *poses_of(LOG)]
    read = read_bags(write(tmp_path, once, set_ahead(once, rise)))
    assert [log.run for log in read.runs] == ["run, part 1", "run, part 2"]
    assert read.warnings == (
        "topic /joint_states: 1 gap of more than 10 s without a message: the drive is cut there",
    )
    np.testing.assert_allclose(read.runs[0].omega, read.runs[1].omega, atol=1e-6)


@pytest.mark.parametrize("arrival", [2**62, 2**63 + 5])
def test_times_of_recording_beyond_64_bits_are_refused(tmp_path, arrival):
    *most, (topic, kind, _, fields) = in_order(states(), poses_of(LOG))
    bag = write_bag(tmp_path / "run", "foxglove", [*most, (topic, kind, arrival, fields)])
    with pytest.raises(LogError, match=rf"time of recording is {arrival} ns: must be below 2\^62"):
        read_bags(bag)
