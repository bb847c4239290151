"""Bags of all kinds, written by rosbags and by MCAP's own writer: complete, split, compressed, cut off, damaged."""

import shutil
import struct

import numpy as np
import pytest
from bags import KINDS, START, contents, expected, in_order, joint_states, joints_of, poses_of, stamp, write_bag
from mcap.reader import make_reader
from mcap.writer import Writer as PlainWriter
from rosbags.highlevel import AnyReader
from wandered import wandered

from trackslip.errors import LogError
from trackslip.ros.bag import open_bag, open_bags

COMPRESSED = [
    *(("ros1", how) for how in ("bz2", "lz4")),
    *(("sqlite3", how) for how in ("file", "message")),
    *(("mcap", how) for how in ("file", "message", "storage")),
    *(("foxglove", how) for how in ("none", "lz4", "zstd")),
]

LOG = wandered(duration=6.0)

MESSAGES = in_order(joints_of(LOG), poses_of(LOG))


@pytest.fixture(scope="module", params=[*((kind, None) for kind in KINDS), *COMPRESSED], ids=str)
def bag(request, tmp_path_factory):
    kind, compression = request.param
    return write_bag(tmp_path_factory.mktemp("bags") / "run", kind, MESSAGES, compression=compression)


def test_every_message_comes_back_with_every_bit(bag):
    opened = open_bag(bag)
    assert contents(opened.messages("/joint_states")) == expected(MESSAGES)
    assert not opened.notes
    assert opened.name == "run"


def test_small_messages_are_read_once(tmp_path):
    path = write_bag(tmp_path / "run", "ros1", MESSAGES)
    opened = open_bag(path)
    path.unlink()
    assert contents(opened.messages("/joint_states")) == expected(MESSAGES)


def test_topics_are_those_that_other_readers_find(bag):
    """rosbags and MCAP's own reader count the same messages of the same types at the same times."""
    topics = open_bag(bag).topics
    if bag.suffix == ".mcap":
        with bag.open("rb") as file:
            summary = make_reader(file).get_summary()
        counts = summary.statistics.channel_message_counts
        assert {name: topic.count for name, topic in topics.items()} == {
            channel.topic: counts[number] for number, channel in summary.channels.items()
        }
    with AnyReader([bag]) as reader:
        assert {name: (topic.type, topic.count) for name, topic in topics.items()} == {
            name: (topic.msgtype, topic.msgcount) for name, topic in reader.topics.items()
        }
        for name, topic in topics.items():
            times = [at for connection, at, _ in reader.messages() if connection.topic == name]
            np.testing.assert_array_equal(topic.arrival, np.sort(times))


def test_rates_and_gaps(tmp_path):
    times = [0.0, 0.1, 0.2, 0.9, 1.0, 1.1]
    path = write_bag(tmp_path / "run", "mcap", [joint_states(stamp(t), ["a"], [0.0]) for t in times])
    topic = open_bag(path).topics["/joint_states"]
    assert (topic.count, topic.rate, topic.longest_gap) == (6, pytest.approx(10.0), pytest.approx(0.7))
    single = write_bag(tmp_path / "one", "mcap", [joint_states(START, ["a"], [0.0])])
    assert np.isnan(open_bag(single).topics["/joint_states"].rate)


@pytest.mark.parametrize("kind", KINDS)
def test_types_that_nobody_knows_are_in_nobodys_way(tmp_path, kind):
    odd = [("/odd", "odd_msgs/msg/Odd", at, {"text": "x", "what": [1, 2]}) for *_, at, _ in MESSAGES[::7]]
    opened = open_bag(write_bag(tmp_path / "run", kind, in_order(MESSAGES, odd)))
    assert opened.topics["/odd"].type == "odd_msgs/msg/Odd"
    assert contents(opened.messages("joint_states")) == expected(MESSAGES)
    with pytest.raises(LogError, match="topic /odd: no message can be decoded: type odd_msgs/msg/Odd is no standard"):
        list(opened.messages("/odd"))


def plain(file, messages):
    """An MCAP file of messages (topic, type, encoding, time [ns], data) whose definitions no parser takes."""
    with file.open("wb") as stream:
        writer = PlainWriter(stream)
        writer.start(profile="", library="another")
        channels = {}
        for topic, kind, encoding, time, data in messages:
            if topic not in channels:
                schema = writer.register_schema(kind, "ros2msg", b"this is ~ no definition")
                channels[topic] = writer.register_channel(topic, encoding, schema)
            writer.add_message(channels[topic], time, data, time)
        writer.finish()
    return open_bag(file)


def test_channels_of_other_encodings_and_broken_definitions(tmp_path):
    """As in files of other programs: JSON beside CDR, a definition that no parser takes, no profile."""
    data = b"\x00\x01\x00\x00" + struct.pack("<iI", 12, 500_000_000) + struct.pack("<I", 1) + bytes(4 + 16)
    json = [("/json", "foo/Bar", "json", k, b"{}") for k in range(3)]
    joints = [("/joint_states", "sensor_msgs/msg/JointState", "cdr", k, data) for k in range(3)]
    opened = plain(tmp_path / "mixed.mcap", [*json, *joints])
    assert {topic.name: topic.count for topic in opened.topics.values()} == {"/json": 3, "/joint_states": 3}
    assert [message.stamp for message in opened.messages("/joint_states")] == [12_500_000_000] * 3


def test_times_that_no_clock_shows_are_bounded(tmp_path):
    opened = plain(tmp_path / "late.mcap", [("/a", "a/msg/A", "cdr", time, b"") for time in (1, 2**63, 2**64 - 1)])
    assert opened.topics["/a"].arrival.tolist() == [1, 2**63 - 1, 2**63 - 1]


def test_parts_of_a_split_recording_are_one_bag(tmp_path):
    halves = MESSAGES[:100], MESSAGES[100:]
    for kind, suffix in (("sqlite3", ".db3"), ("mcap", ".mcap"), ("ros1", ".bag")):
        folder = tmp_path / kind
        folder.mkdir()
        for k, part in enumerate(halves):
            written = write_bag(tmp_path / f"{kind}{k}", kind, part)
            file = written if written.is_file() else written / f"{kind}{k}{suffix}"
            shutil.copy(file, folder / f"run_{k}{suffix}")
        opened = open_bag(folder)
        assert opened.name == "run"
        assert contents(opened.messages("/joint_states")) == expected(MESSAGES)
        assert opened.topics["/joint_states"].count == len(expected(MESSAGES))


def test_numbered_drives_with_pauses_in_between_are_several(tmp_path):
    for k in range(3):
        write_bag(tmp_path / f"drive_{k}", "foxglove", joints_of(LOG, start=START + k * 60_000_000_000))
    assert [bag.name for bag in open_bags(tmp_path)] == ["drive_0", "drive_1", "drive_2"]
    with pytest.raises(LogError, match=r"holds 3 bags \(drive_0, drive_1, drive_2\): name one"):
        open_bag(tmp_path)


def test_a_part_that_is_missing_is_named(tmp_path):
    folder = write_bag(tmp_path / "run", "mcap", MESSAGES)
    about = (folder / "metadata.yaml").read_text().replace("- run.mcap", "- run.mcap\n  - run_1.mcap")
    (folder / "metadata.yaml").write_text(about)
    assert open_bag(folder).notes == ("run: its file run_1.mcap is missing",)
