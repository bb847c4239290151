import numpy as np
import pytest
from bags import JOINTS, START, joint_states, joints_of, open_bag, sprocket_angles, stamp, write_bag
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from plain_drives import wandered

from trackslip.bags.choice import AUTOMATIC, BagChoice
from trackslip.bags.encoders import read_encoders
from trackslip.bags.topics import sides
from trackslip.errors import LogError
from trackslip.logs.angles import unwrapped_angle

LOG = wandered(duration=6.0)
TURNED = sprocket_angles(LOG)


def read(tmp_path, messages, choice=AUTOMATIC, notes=None):
    notes = [] if notes is None else notes
    return read_encoders(open_bag(write_bag(tmp_path / "run", "mcap", messages)), choice, notes)


def states(names, positions=None, velocities=None, topic="/joint_states", time=LOG.time):
    empty = [()] * len(time)
    positions = empty if positions is None else positions
    velocities = empty if velocities is None else velocities
    return [
        joint_states(stamp(t), names, p, v, topic=topic)
        for t, p, v in zip(time, positions, velocities, strict=True)
    ]


def test_speeds_are_means_since_the_reading_before(tmp_path):
    found = read(tmp_path, joints_of(LOG))
    np.testing.assert_array_equal(found.stamp, [stamp(t) for t in LOG.time])
    np.testing.assert_allclose(found.values[1:], LOG.omega[1:], atol=1e-11)
    np.testing.assert_array_equal(found.values[0], found.values[1])
    assert found.joints == (("left_wheel",), ("right_wheel",))


def test_messages_that_repeat_a_reading_count_once(tmp_path):
    notes = []
    held = TURNED[np.arange(len(TURNED)) // 3 * 3]
    found = read(tmp_path, states(["left", "right"], held), notes=notes)
    times = LOG.time[::3]
    np.testing.assert_array_equal(found.stamp, [stamp(t) for t in times])
    means = np.diff(TURNED[::3], axis=0) / np.diff(times)[:, None]
    np.testing.assert_allclose(found.values[1:], means, atol=1e-9)
    assert notes == [
        "topic /joint_states: each encoder reading is repeated in 3 messages: it counts once"
    ]


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
    scale = np.array([0.9, 1.1, 1.1, 0.9])
    found = read(tmp_path, states(names, TURNED[:, [0, 1, 0, 1]] * scale))
    np.testing.assert_allclose(found.values[1:], LOG.omega[1:], atol=1e-10)
    chosen = BagChoice(left=("front_left_wheel",), right=("rear_right_wheel",))
    found = read(tmp_path / "chosen", states(names, TURNED[:, [0, 1, 0, 1]] * scale), chosen)
    np.testing.assert_allclose(found.values[1:], 0.9 * LOG.omega[1:], atol=1e-10)


@pytest.mark.parametrize("choice", [BagChoice(), BagChoice(encoders="/left,/right")])
def test_sides_in_two_topics(tmp_path, choice):
    messages = []
    for time, (left, right) in zip(LOG.time, TURNED.tolist(), strict=True):
        messages.append(joint_states(stamp(time), ["left_wheel"], [left], topic="/left"))
        messages.append(
            joint_states(stamp(time), ["right_wheel"], [right], topic="/right", late=2_000_000)
        )
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
    np.testing.assert_allclose(found.values[1:], np.column_stack([middle, 3.0 - middle]), atol=1e-9)
    assert any(
        "speeds are its velocities, because it states no positions" in note for note in notes
    )


@pytest.mark.parametrize("positions", [np.full_like(TURNED, np.nan), np.zeros_like(TURNED)])
def test_positions_that_are_not_measured_give_way_to_velocities(tmp_path, positions):
    found = read(tmp_path, states(["left", "right"], positions, LOG.omega))
    np.testing.assert_allclose(found.values[1:], (LOG.omega[1:] + LOG.omega[:-1]) / 2, atol=1e-9)
    positions = TURNED.copy()
    positions[40, 0] = np.nan
    bridged = read(tmp_path / "bridged", states(["left", "right"], positions))
    np.testing.assert_allclose(bridged.values[60:], LOG.omega[60:], atol=1e-10)


def test_the_topic_that_is_measured_is_chosen(tmp_path):
    commands = states(["left", "right"], TURNED + 1, topic="/joint_commands")
    arm = states(["shoulder", "elbow"], TURNED, topic="/arm/joint_states")
    assert (
        read(tmp_path, [*states(["left", "right"], TURNED), *commands, *arm]).source
        == "/joint_states"
    )
    base = states(["left", "right"], TURNED, topic="/base/joint_states")
    other = states(["left", "right"], TURNED, topic="/other/joint_states")
    with pytest.raises(
        LogError,
        match="encoders may be /base/joint_states, /other/joint_states: choose with --encoders",
    ):
        read(tmp_path / "two", [*base, *other, *arm])
    found = read(tmp_path / "named", [*base, *other], BagChoice(encoders="other/joint_states"))
    assert found.source == "/other/joint_states"


SIDES = states(["left", "right"], TURNED)
ODD = ("/odd", "odd_msgs/msg/Odd", 5, {})
UNSTAMPED = [
    joint_states(0, ["left", "right"], p, late=stamp(k / 20)) for k, p in enumerate(TURNED.tolist())
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
    found = sides(names)
    assert found is not None
    assert list(found[0]) == left
    assert list(found[1]) == (right or [name.replace("left", "right") for name in left])


def test_ticks_are_named_with_what_to_do_with_them(tmp_path):
    counts = [
        (topic, f"std_msgs/msg/{kind}", START, {"data": data})
        for topic, kind, data in (
            ("/left_ticks", "Int32", 5),
            ("/right_ticks", "Int32", 6),
            ("/encoders", "Int64MultiArray", [1, 2]),
        )
    ]
    named = (
        r"/encoders\[0\] \(.*Int64MultiArray\), /encoders\[1\] \(.*Int64MultiArray\), "
        r"/left_ticks \(std_msgs/msg/Int32\), /right_ticks \(std_msgs/msg/Int32\)"
    )
    option = "--encoders /left_ticks,/right_ticks --ticks-per-turn N reads them"
    with pytest.raises(LogError, match=f"{named} may count ticks: {option}"):
        read(tmp_path, counts)
