import numpy as np
import pytest
from bags import JOINTS, START, joint_states, joints_of, open_bag, sprocket_angles, stamp, write_bag
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from plain_drives import wandered

from trackslip.bags.choice import AUTOMATIC, BagChoice
from trackslip.bags.encoders import read_encoders, side_turns
from trackslip.bags.topics import sides
from trackslip.errors import LogError
from trackslip.logs.angles import unwrapped_angle

LOG = wandered(duration=6.0)
TURNED = sprocket_angles(LOG)


def read(tmp_path, messages, choice=AUTOMATIC, notes=None):
    notes = [] if notes is None else notes
    bag = open_bag(write_bag(tmp_path / "run", "mcap", messages))
    return read_encoders(bag, choice, notes)


def states(names, positions=None, velocities=None, topic="/joint_states", time=LOG.time):
    empty = [()] * len(time)
    positions = empty if positions is None else positions
    velocities = empty if velocities is None else velocities
    messages = []
    for at, position, velocity in zip(time, positions, velocities, strict=True):
        messages.append(joint_states(stamp(at), names, position, velocity, topic=topic))
    return messages


def test_speeds_are_means_since_the_reading_before(tmp_path):
    found = read(tmp_path, joints_of(LOG))
    np.testing.assert_array_equal(found.stamp, [stamp(t) for t in LOG.time])
    np.testing.assert_allclose(found.values[1:], LOG.omega[1:], atol=1e-11)
    np.testing.assert_array_equal(found.values[0], found.values[1])
    assert found.joints == (("left_wheel",), ("right_wheel",))


def test_messages_that_repeat_a_reading_count_once(tmp_path):
    notes = []
    first_of_three = np.arange(len(TURNED)) // 3 * 3
    found = read(tmp_path, states(["left", "right"], TURNED[first_of_three]), notes=notes)
    times = LOG.time[::3]
    np.testing.assert_array_equal(found.stamp, [stamp(t) for t in times])
    means = np.diff(TURNED[::3], axis=0) / np.diff(times)[:, None]
    np.testing.assert_allclose(found.values[1:], means, atol=1e-9)
    (note,) = notes
    said = "each encoder reading is repeated in 3 messages: it counts once"
    assert note == f"topic /joint_states: {said}"


@given(
    arrays(float, 30, elements=st.floats(-3.1, 3.1)),
    st.floats(-3.14, 3.14),
    st.sampled_from([-np.pi, 0.0]),
)
def test_unwrapping_undoes_wrapping(steps, first, low):
    angle = first + np.concatenate([[0.0], np.cumsum(steps)])
    wrapped = (angle - low) % (2 * np.pi) + low
    np.testing.assert_allclose(np.diff(unwrapped_angle(wrapped)), steps, atol=1e-9)


def test_several_wheels_a_side_are_averaged(tmp_path):
    names = ["front_left_wheel", "front_right_wheel", "rear_left_wheel", "rear_right_wheel"]
    angles = TURNED[:, [0, 1, 0, 1]] * [0.9, 1.1, 1.1, 0.9]
    found = read(tmp_path, states(names, angles))
    np.testing.assert_allclose(found.values[1:], LOG.omega[1:], atol=1e-10)
    front_left_rear_right = BagChoice(left=("front_left_wheel",), right=("rear_right_wheel",))
    found = read(tmp_path / "chosen", states(names, angles), front_left_rear_right)
    np.testing.assert_allclose(found.values[1:], 0.9 * LOG.omega[1:], atol=1e-10)


STEADY = np.full(100, 0.1)  # a wheel that turns by 10 rad


@pytest.mark.parametrize(
    ("share", "is_dead"),
    [
        pytest.param(0.0099, True, id="dead"),
        pytest.param(-0.0099, True, id="dead, but for noise"),
        pytest.param(0.0101, False, id="slow"),
    ],
)
def test_an_encoder_is_dead_below_a_hundredth(share, is_dead):
    notes = []
    turns = {"front": share * STEADY, "rear": STEADY}
    found = side_turns("/joints", ["front", "rear"], turns, notes)
    np.testing.assert_allclose(found, STEADY if is_dead else (1 + share) / 2 * STEADY)
    said = "topic /joints: joint front left out: it stands still while rear turns"
    assert notes == ([said] if is_dead else [])


@pytest.mark.parametrize(("turn", "is_dead"), [(1.0, False), (1.01, True)])
def test_no_encoder_is_dead_before_a_turn_of_a_radian(turn, is_dead):
    notes = []
    front = np.array([turn / 2, turn / 2])
    found = side_turns("/joints", ["front", "rear"], {"front": front, "rear": 0 * front}, notes)
    np.testing.assert_allclose(found, front if is_dead else front / 2)
    assert len(notes) == is_dead


def turns_at_an_angle(degrees):
    """Turns of two wheels that are this angle apart, as vectors."""
    angle = np.radians(degrees)
    front = np.array([10.0, 0.0])
    rear = 5.0 * np.array([np.cos(angle), np.sin(angle)])
    return {"front": front, "rear": rear}


def test_wheels_against_each_other_correlate_by_minus_a_half():
    notes = []
    nearly = turns_at_an_angle(119)
    found = side_turns("/joints", ["front", "rear"], nearly, notes)
    np.testing.assert_allclose(found, (nearly["front"] + nearly["rear"]) / 2)
    said = "topic /joints: joints front and rear of one side turn against each other: choose with"
    with pytest.raises(LogError, match=said):
        side_turns("/joints", ["front", "rear"], turns_at_an_angle(121), notes)
    assert notes == []


@pytest.mark.parametrize(
    ("side", "signs"), [(None, [1, 1]), ("left", [-1, 1]), ("right", [1, -1]), ("both", [-1, -1])]
)
def test_a_reversed_side_turns_the_other_way(tmp_path, side, signs):
    found = read(tmp_path, joints_of(LOG), BagChoice(reversed=side))
    np.testing.assert_allclose(found.values[1:], signs * LOG.omega[1:], atol=1e-11)


def test_readings_are_those_between_which_all_joints_are_known(tmp_path):
    """The left joint from reading 20 on, the right one, at a third of its rate, up to 90."""
    messages = []
    for k, (left, right) in enumerate(TURNED.tolist()):
        at = stamp(LOG.time[k])
        if k >= 20:
            messages.append(joint_states(at, ["left"], [left], topic="/left"))
        if k % 3 == 0 and k <= 90:
            messages.append(joint_states(at, ["right"], [right], topic="/right", late=2_000_000))
    found = read(tmp_path, messages)
    np.testing.assert_array_equal(found.stamp, [stamp(t) for t in LOG.time[20:91]])
    left = np.diff(TURNED[20:91, 0])
    right = np.diff(np.interp(LOG.time[20:91], LOG.time[:91:3], TURNED[:91:3, 1]))
    np.testing.assert_allclose(np.diff(found.turned, axis=0), np.column_stack([left, right]))


@pytest.mark.parametrize("choice", [BagChoice(), BagChoice(encoders="/left,/right")])
def test_sides_in_two_topics(tmp_path, choice):
    messages = []
    for time, (left, right) in zip(LOG.time, TURNED.tolist(), strict=True):
        at = stamp(time)
        messages.append(joint_states(at, ["left_wheel"], [left], topic="/left"))
        messages.append(joint_states(at, ["right_wheel"], [right], topic="/right", late=2_000_000))
    found = read(tmp_path, messages, choice)
    assert found.source == "/left and /right"
    np.testing.assert_allclose(found.values[1:], LOG.omega[1:], atol=1e-9)


def test_velocities_where_there_are_no_positions(tmp_path):
    """Velocities are samples: their means by the trapezoidal rule, exact for speeds linear in
    time.
    """
    speed = np.column_stack([LOG.time, 3.0 - LOG.time])
    notes = []
    found = read(tmp_path, states(["left", "right"], None, speed), notes=notes)
    middle = (LOG.time[1:] + LOG.time[:-1]) / 2
    expected = np.column_stack([middle, 3.0 - middle])
    np.testing.assert_allclose(found.values[1:], expected, atol=1e-9)
    said = "speeds are its velocities, because it states no positions"
    assert any(said in note for note in notes)


@pytest.mark.parametrize("positions", [np.full_like(TURNED, np.nan), np.zeros_like(TURNED)])
def test_positions_that_are_not_measured_give_way_to_velocities(tmp_path, positions):
    found = read(tmp_path, states(["left", "right"], positions, LOG.omega))
    means = (LOG.omega[1:] + LOG.omega[:-1]) / 2
    np.testing.assert_allclose(found.values[1:], means, atol=1e-9)
    positions = TURNED.copy()
    positions[40, 0] = np.nan
    bridged = read(tmp_path / "bridged", states(["left", "right"], positions))
    np.testing.assert_allclose(bridged.values[60:], LOG.omega[60:], atol=1e-10)


@pytest.mark.parametrize(("unknown", "by_position"), [(59, True), (60, False)])
def test_positions_count_if_most_are_finite(tmp_path, unknown, by_position):
    positions = TURNED.copy()
    positions[-unknown:] = np.nan
    slow = LOG.omega / 2  # velocities that contradict the positions
    notes = []
    found = read(tmp_path, states(["left", "right"], positions, slow), notes=notes)
    assert len(notes) == (not by_position)
    assert len(found.stamp) == (len(LOG.time) - unknown if by_position else len(LOG.time))


@pytest.mark.parametrize(("speed", "note_count"), [(0.99e-3, 0), (1.01e-3, 1)])
def test_a_robot_at_rest_may_report_a_millirad_a_second(tmp_path, speed, note_count):
    velocities = np.full_like(TURNED, -speed)
    notes = []
    found = read(tmp_path, states(["left", "right"], 0 * TURNED + 1, velocities), notes=notes)
    assert len(notes) == note_count
    np.testing.assert_allclose(found.values, -speed * note_count)


def test_a_number_beyond_a_billion_radians_is_no_angle(tmp_path):
    positions = TURNED + 0.9e9
    positions[40] = 1.1e9, -1.1e9
    found = read(tmp_path, states(["left", "right"], positions))
    at = np.delete(LOG.time, 40)
    np.testing.assert_array_equal(found.stamp, [stamp(t) for t in at])
    turned = np.delete(TURNED, 40, axis=0)
    np.testing.assert_allclose(found.turned, turned - turned[0], atol=1e-5)


def test_the_topic_that_is_measured_is_chosen(tmp_path):
    measured = states(["left", "right"], TURNED)
    commands = states(["left", "right"], TURNED + 1, topic="/joint_commands")
    arm = states(["shoulder", "elbow"], TURNED, topic="/arm/joint_states")
    found = read(tmp_path, [*measured, *commands, *arm])
    assert found.source == "/joint_states"
    base = states(["left", "right"], TURNED, topic="/base/joint_states")
    other = states(["left", "right"], TURNED, topic="/other/joint_states")
    said = "encoders may be /base/joint_states, /other/joint_states: choose with --encoders"
    with pytest.raises(LogError, match=said):
        read(tmp_path / "two", [*base, *other, *arm])
    found = read(tmp_path / "named", [*base, *other], BagChoice(encoders="other/joint_states"))
    assert found.source == "/other/joint_states"


def test_joints_of_commands_are_read_if_there_are_no_others(tmp_path):
    commands = states(["left", "right"], TURNED, topic="/joint_commands")
    assert read(tmp_path, commands).source == "/joint_commands"


SIDES = states(["left", "right"], TURNED)
ODD = ("/odd", "odd_msgs/msg/Odd", 5, {})
UNSTAMPED = [
    joint_states(0, ["left", "right"], angle, late=stamp(k / 20))
    for k, angle in enumerate(TURNED.tolist())
]


@pytest.mark.parametrize(
    ("messages", "choice", "line"),
    [
        ([ODD], {}, "no encoders: no topic of sensor_msgs/.*JointState; its topics are /odd"),
        (
            states(["a", "b"], TURNED),
            {},
            r"which of its joints are left and right\? It has a, b: choose",
        ),
        (
            SIDES,
            {"left": ("left",), "right": ("c",)},
            "right = 'c': topic /joint_states has no such joint; its joints",
        ),
        (
            states(["left", "right"]),
            {},
            "topic /joint_states: joint left states neither positions nor velocities",
        ),
        (
            [*SIDES, ODD],
            {"encoders": "/odd"},
            f"topic /odd has messages of odd_msgs/msg/Odd, needs {JOINTS}",
        ),
        (SIDES, {"encoders": "/wheels"}, "it has no topic '/wheels'; its topics are /joint_states"),
        (UNSTAMPED, {}, "120 of its 120 header stamps are 0: its publisher states no time, or"),
        (SIDES[:1], {}, "fewer than 2 messages with the joints chosen"),
    ],
)
def test_what_cannot_be_read_is_refused_in_a_line(tmp_path, messages, choice, line):
    with pytest.raises(LogError, match=line):
        read(tmp_path, messages, BagChoice(**choice))


@pytest.mark.parametrize(
    ("names", "left", "right"),
    [
        (["left_wheel", "right_wheel"], ["left_wheel"], ["right_wheel"]),
        (
            ["rr_wheel", "fl_wheel", "fr_wheel", "rl_wheel"],
            ["fl_wheel", "rl_wheel"],
            ["rr_wheel", "fr_wheel"],
        ),
        (["LeftTrack", "RightTrack"], ["LeftTrack"], ["RightTrack"]),
        (
            ["leftwheel1", "leftwheel2", "rightwheel1", "rightwheel2"],
            ["leftwheel1", "leftwheel2"],
            None,
        ),
        (["arm_left_joint", "arm_right_joint", "motor_l", "motor_r"], ["motor_l"], ["motor_r"]),
        (
            ["left_steer", "right_steer", "left_wheel", "right_wheel"],
            ["left_wheel"],
            ["right_wheel"],
        ),
        (
            ["panther/fl_wheel_joint", "panther/fr_wheel_joint"],
            ["panther/fl_wheel_joint"],
            ["panther/fr_wheel_joint"],
        ),
    ],
)
def test_common_names(names, left, right):
    expected_right = right or [name.replace("left", "right") for name in left]
    found_left, found_right = sides(names)
    assert list(found_left) == left
    assert list(found_right) == expected_right


def test_ticks_are_named_with_what_to_do_with_them(tmp_path):
    counts = [
        ("/left_ticks", "std_msgs/msg/Int32", START, {"data": 5}),
        ("/right_ticks", "std_msgs/msg/Int32", START, {"data": 6}),
        ("/encoders", "std_msgs/msg/Int64MultiArray", START, {"data": [1, 2]}),
    ]
    named = (
        r"/encoders\[0\] \(.*Int64MultiArray\), /encoders\[1\] \(.*Int64MultiArray\), "
        r"/left_ticks \(std_msgs/msg/Int32\), /right_ticks \(std_msgs/msg/Int32\)"
    )
    option = "--encoders /left_ticks,/right_ticks --ticks-per-turn N reads them"
    with pytest.raises(LogError, match=f"{named} may count ticks: {option}"):
        read(tmp_path, counts)
