"""Odometry of the wheels in place of encoders: from its poses, with its twists as a check."""

import numpy as np
import pytest
from bags import in_order, odometry, open_bag, pose_stamped, stamp, write_bag

from trackslip import identify
from trackslip.bags.choice import BagChoice
from trackslip.bags.encoders import read_encoders
from trackslip.errors import InvalidValueError, LogError
from trackslip.kinematics import RobotGeometry
from trackslip.logs.layout import Layout

GEOMETRY = RobotGeometry(0.15, 0.05)
LAYOUT = Layout(robot=GEOMETRY)
CHOICE = BagChoice(encoders="/odom")
MULTIPLIER = 1.15
STEP = 0.05
TIME = np.arange(0, 60, STEP)
SPEED = 0.2 + 0.1 * np.sin(TIME / 4)
RATE = 0.5 * np.sin(TIME / 2.3)


def path(speed, rate):
    """Poses (T, 3) after each step at a speed and a yaw rate (T,), on arcs."""
    turn = rate * STEP
    heading = np.cumsum(turn)
    chord = speed * STEP * np.sinc(turn / (2 * np.pi))
    x = np.cumsum(chord * np.cos(heading - turn / 2))
    y = np.cumsum(chord * np.sin(heading - turn / 2))
    return np.column_stack([x, y, heading])


RECKONED = path(SPEED, MULTIPLIER * RATE)
TWISTS = {
    "right": (SPEED, MULTIPLIER * RATE),
    "world": (SPEED * np.cos(RECKONED[:, 2]), MULTIPLIER * RATE),
    "step": (SPEED * STEP, MULTIPLIER * RATE * STEP),
    "zero": (0 * SPEED, 0 * RATE),
    "slow": (SPEED / 2, MULTIPLIER * RATE),
}
SAID = {
    "right": "",
    "world": "it is in the world's frame, not the robot's",
    "step": "it is per message, not per second",
    "zero": "it is 0",
    "slow": "0.5 times the distance and 1 times the turn",
}


def messages(kind="right", poses=RECKONED):
    return odometries(TWISTS[kind], poses)


def odometries(twist, poses):
    """Messages with twists (v, w), each (T,), and poses (T, 3)."""
    made = []
    for time, where, v, w in zip(TIME[: len(poses)], poses.tolist(), *twist, strict=True):
        topic, name, at, fields = odometry(stamp(time), where)
        twist = {"linear": {"x": float(v)}, "angular": {"z": float(w)}}
        made.append((topic, name, at, fields | {"twist": {"twist": twist}}))
    return made


def read(tmp_path, kind="right", poses=RECKONED, layout=LAYOUT):
    notes = []
    bag = open_bag(write_bag(tmp_path / "run", "mcap", messages(kind, poses)))
    return read_encoders(bag, CHOICE, notes, layout), notes


@pytest.mark.parametrize("kind", TWISTS)
def test_speeds_are_from_the_pose_whatever_the_twist_is(tmp_path, kind):
    found, notes = read(tmp_path, kind)
    turn = MULTIPLIER * RATE * GEOMETRY.half_gauge
    expected = np.column_stack([SPEED - turn, SPEED + turn]) / GEOMETRY.sprocket_radius
    np.testing.assert_allclose(found.values[1:], expected[1:], atol=1e-6)
    said = f"topic /odom: its twist contradicts its pose ({SAID[kind]}): speeds of the sprockets"
    if SAID[kind]:
        (note,) = notes
        assert said in note
    else:
        assert notes == []


AHEAD = path(SPEED, 0 * RATE)
ON_THE_SPOT = path(0 * SPEED, RATE)
BOTH = path(SPEED, RATE)
HALF = np.full(len(TIME), 0.15)
STEADY = path(2 * HALF, 2 * HALF)


@pytest.mark.parametrize(
    ("poses", "twist", "said"),
    [
        pytest.param(AHEAD, (2 * SPEED, RATE), "2 times the distance", id="ahead"),
        pytest.param(ON_THE_SPOT, (SPEED, RATE / 2), "0.5 times the turn", id="on the spot"),
        pytest.param(
            ON_THE_SPOT, (0 * SPEED, RATE * STEP), "it is per message, not per second", id="step"
        ),
        pytest.param(
            BOTH, (1.12 * SPEED, RATE), "1.12 times the distance and 1 times the turn", id="faster"
        ),
        pytest.param(
            BOTH, (SPEED, -RATE), "1 times the distance and -1 times the turn", id="clockwise"
        ),
        pytest.param(BOTH, (1.08 * SPEED, 0.92 * RATE), "", id="nearly right"),
        pytest.param(STEADY[:41], (HALF[:41], HALF[:41]), "", id="2 s"),
        pytest.param(
            STEADY[:42],
            (HALF[:42], HALF[:42]),
            "0.5 times the distance and 0.5 times the turn",
            id="more than 2 s",
        ),
    ],
)
def test_twists_are_compared_with_how_poses_move(tmp_path, poses, twist, said):
    """Each second, if there are two, by distances and turns where there are any, to a tenth."""
    notes = []
    bag = open_bag(write_bag(tmp_path / "run", "mcap", odometries(twist, poses)))
    read_encoders(bag, CHOICE, notes, LAYOUT)
    found = [note.split(" (")[1].split(")")[0] for note in notes]
    assert found == ([said] if said else [])


@pytest.mark.parametrize(
    ("speed", "rate", "said"),
    [
        pytest.param(0.09, 0.09, "", id="neither"),
        pytest.param(0.11, 0.09, "2 times the distance", id="distances"),
        pytest.param(0.09, 0.11, "2 times the turn", id="turns"),
    ],
)
def test_a_decimetre_and_a_tenth_of_a_radian_a_second_compare(tmp_path, speed, rate, said):
    """In the root mean square, so that motions of half the time count for 0.7 of their size."""
    drives = TIME < 30
    v = np.sqrt(2) * speed * drives
    w = np.sqrt(2) * rate * drives
    notes = []
    bag = open_bag(write_bag(tmp_path / "run", "mcap", odometries((2 * v, 2 * w), path(v, w))))
    read_encoders(bag, CHOICE, notes, LAYOUT)
    found = [note.split(" (")[1].split(")")[0] for note in notes]
    assert found == ([said] if said else [])


@pytest.mark.parametrize("factor", [0.82, 0.78, 1.18, 1.22])
def test_a_twist_per_message_is_known_to_a_fifth(tmp_path, factor):
    notes = []
    per_message = factor * STEP
    twist = (per_message * SPEED, per_message * RATE)
    bag = open_bag(write_bag(tmp_path / "run", "mcap", odometries(twist, BOTH)))
    read_encoders(bag, CHOICE, notes, LAYOUT)
    (note,) = notes
    assert ("it is per message, not per second" in note) == (abs(factor - 1) < 0.2)


@pytest.mark.parametrize("kind", ["world", "zero"])
def test_the_multiplier_is_right_whatever_the_twist_is(tmp_path, kind):
    rng = np.random.default_rng(0)
    measured = path(SPEED, RATE) + 0.002 * rng.standard_normal((len(TIME), 3))
    poses = []
    for time, where in zip(TIME, measured.tolist(), strict=True):
        poses.append(pose_stamped(stamp(time), where))
    bag = write_bag(tmp_path / "run", "mcap", in_order(messages(kind), poses))
    found = identify(bag, GEOMETRY, bag=CHOICE, multiplier=1.0)
    gain = found.answer["wheel_separation_multiplier"]
    assert abs(gain.value - MULTIPLIER) < max(gain.error, 1e-3)


def test_a_pose_that_is_never_filled_in_gives_way_to_the_twist(tmp_path):
    found, notes = read(tmp_path, poses=np.zeros_like(RECKONED))
    distance = GEOMETRY.sprocket_radius * found.values[1:].mean(axis=1)
    np.testing.assert_allclose(distance, (SPEED[1:] + SPEED[:-1]) / 2, atol=1e-6)
    (note,) = notes
    assert note == "topic /odom: its pose never changes: speeds of the sprockets are from its twist"


def test_odometry_that_never_moves_or_jumps_is_refused(tmp_path):
    with pytest.raises(LogError, match="neither its pose nor its twist ever changes"):
        read(tmp_path, "zero", np.zeros_like(RECKONED))
    reset = RECKONED.copy()
    reset[600:] -= reset[600]
    said = r"its pose jumps by .* m after 30 s: was the odometry reset"
    with pytest.raises(LogError, match=said):
        read(tmp_path / "reset", poses=reset)


def test_the_geometry_that_the_odometry_assumed_may_differ(tmp_path):
    wider = RobotGeometry(GEOMETRY.half_gauge * MULTIPLIER, GEOMETRY.sprocket_radius)
    found, _ = read(tmp_path, layout=Layout(odometry=wider, robot=GEOMETRY))
    turn = wider.half_gauge * MULTIPLIER * RATE
    expected = np.column_stack([SPEED - turn, SPEED + turn]) / GEOMETRY.sprocket_radius
    np.testing.assert_allclose(found.values[1:], expected[1:], atol=1e-6)
    with pytest.raises(InvalidValueError, match=r"odometry = None: must be given \(--odom-half"):
        read(tmp_path / "unknown", layout=Layout())
