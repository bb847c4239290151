"""Counters in messages of any type in place of encoders."""

import numpy as np
import pytest
from bags import (
    START,
    header,
    in_order,
    joints_of,
    open_bag,
    poses_of,
    sprocket_angles,
    store,
    write_bag,
)
from plain_drives import wandered
from rosbags.typesys import get_types_from_msg

from trackslip import load
from trackslip.bags.choice import AUTOMATIC, BagChoice
from trackslip.bags.encoders import read_encoders
from trackslip.errors import InvalidValueError, LogError, LogWarning
from trackslip.logs.layout import Layout

LOG = wandered(duration=20.0)
PER_TURN = 2000
LAYOUT = Layout(ticks_per_turn=PER_TURN)
TICKS = np.floor(sprocket_angles(LOG) / (2 * np.pi) * PER_TURN).astype(int)
EXACT = 2 * np.pi / PER_TURN * (TICKS[-1] - TICKS[0])
CUSTOM = "drive_msgs/msg/Ticks"
store(False).register(
    get_types_from_msg("std_msgs/Header header\nint32 left\nint32 right\nint32 battery", CUSTOM)
)


def arrivals():
    return [START + round(1e9 * time) for time in LOG.time]


def in_two_topics(ticks=TICKS, kind="Int32"):
    type_name = f"std_msgs/msg/{kind}"
    messages = []
    for at, (left, right) in zip(arrivals(), ticks, strict=True):
        messages.append(("/left_encoder", type_name, at, {"data": int(left)}))
        messages.append(("/right_encoder", type_name, at, {"data": int(right)}))
    return messages


def in_one_message():
    messages = []
    for at, (left, right) in zip(arrivals(), TICKS, strict=True):
        fields = {"header": header(at), "left": int(left), "right": int(right), "battery": 99}
        messages.append(("/wheel_ticks", CUSTOM, at, fields))
    return messages


def in_an_array():
    return [
        ("/encoders", "std_msgs/msg/Int64MultiArray", at, {"data": row.tolist()})
        for at, row in zip(arrivals(), TICKS, strict=True)
    ]


def read(tmp_path, messages, choice=AUTOMATIC, layout=LAYOUT, notes=None):
    bag = open_bag(write_bag(tmp_path / "run", "mcap", messages))
    return read_encoders(bag, choice, [] if notes is None else notes, layout)


@pytest.mark.parametrize(
    ("messages", "choice"),
    [
        (in_two_topics(), BagChoice(encoders="/left_encoder,/right_encoder")),
        (in_two_topics(kind="Int64"), BagChoice(encoders="left_encoder, right_encoder")),
        (in_one_message(), BagChoice(encoders="/wheel_ticks")),
        (in_one_message(), BagChoice(encoders="/wheel_ticks", left=("left",), right=("right",))),
        (
            in_an_array(),
            BagChoice(encoders="/encoders", left=("/encoders[0]",), right=("/encoders[1]",)),
        ),
    ],
)
def test_ticks_in_messages_of_any_type_are_read(tmp_path, messages, choice):
    found = read(tmp_path, messages, choice)
    np.testing.assert_allclose(found.turned[-1], EXACT, atol=1e-9)


def test_counters_that_wrap_are_unwound_and_stamps_are_told(tmp_path):
    notes = []
    wrapped = (TICKS + 2**15) % 2**16 - 2**15
    choice = BagChoice(encoders="/left_encoder,/right_encoder")
    found = read(tmp_path, in_two_topics(wrapped, "Int16"), choice, notes=notes)
    np.testing.assert_allclose(found.turned[-1], EXACT, atol=1e-9)
    said = "topic /left_encoder: its messages have no stamps: times of recording"
    assert said in notes[0]


def test_counters_are_named_with_the_option_that_reads_them(tmp_path):
    cases = [
        (in_two_topics(), "--encoders /left_encoder,/right_encoder --ticks-per-turn N"),
        (in_one_message(), "--encoders /wheel_ticks --ticks-per-turn N"),
        (in_an_array(), "--encoders /encoders --ticks-per-turn N --left NAMES --right NAMES"),
    ]
    for k, (messages, option) in enumerate(cases):
        with pytest.raises(LogError) as refused:
            read(tmp_path / str(k), messages)
        assert str(refused.value).endswith(f"may count ticks: {option} reads them")
        assert "battery" not in str(refused.value)


def test_ticks_per_turn_are_needed(tmp_path):
    choice = BagChoice(encoders="/wheel_ticks")
    with pytest.raises(InvalidValueError, match=r"ticks_per_turn = None: must be given \(--ticks"):
        read(tmp_path, in_one_message(), choice, Layout())
    joints = joints_of(LOG)
    with pytest.raises(InvalidValueError, match="must be left out: topic /joint_states states ang"):
        read(tmp_path / "joints", joints)


def test_a_counter_that_restarts_is_refused(tmp_path):
    """With its counts before and after, and the time since its first reading."""
    ticks = TICKS.copy()
    ticks[200:] -= ticks[200]
    choice = BagChoice(encoders="/left_encoder,/right_encoder")
    counts = f"from {TICKS[199, 0]} to 0 after {LOG.time[200]:.6g} s"
    said = rf"/left_encoder jumps {counts}, .*did the counter restart\? Cut the bag"
    with pytest.raises(LogError, match=said):
        read(tmp_path, in_two_topics(ticks), choice)


def test_a_bag_with_ticks_and_poses_is_a_log(tmp_path):
    path = write_bag(tmp_path / "run", "mcap", in_order(in_two_topics(), poses_of(LOG)))
    choice = BagChoice(encoders="/left_encoder,/right_encoder")
    with pytest.warns(LogWarning, match="have no stamps: times of recording"):
        (run,) = load(path, choice, ticks_per_turn=PER_TURN)
    np.testing.assert_allclose(np.diff(run.time) @ run.omega[1:], EXACT, atol=1e-9)
