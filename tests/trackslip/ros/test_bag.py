"""Bags of all kinds, written by rosbags and by MCAP's own writer: complete, split, compressed, cut off, damaged."""

import re
import shutil
import sqlite3
import struct

import numpy as np
import pytest
from bags import (
    JOINTS,
    KINDS,
    START,
    header,
    in_order,
    joint_states,
    joints_of,
    pose_stamped,
    poses_of,
    stamp,
    write_bag,
)
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer as PlainWriter
from rosbags.highlevel import AnyReader
from wandered import wandered

from trackslip.errors import LogError, TrackslipError
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


def contents(messages):
    """Name, stamp and numbers of joint states."""
    return [(m.topic, m.arrival, m.stamp, tuple(m.content.name), *m.content.position) for m in messages]


def expected():
    return [
        (topic, at, at - 1_000_000, ("left_wheel", "right_wheel"), *fields["position"])
        for topic, kind, at, fields in MESSAGES
        if kind == JOINTS
    ]


def test_every_message_comes_back_with_every_bit(bag):
    opened = open_bag(bag)
    assert contents(opened.messages("/joint_states")) == expected()
    assert not opened.notes
    assert opened.name == "run"


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


def test_types_that_nobody_knows_are_in_nobodys_way(tmp_path):
    odd = [("/odd", "odd_msgs/msg/Odd", at, {"text": "x", "what": [1, 2]}) for *_, at, _ in MESSAGES[::7]]
    for kind in KINDS:
        path = write_bag(tmp_path / kind, kind, in_order(MESSAGES, odd))
        opened = open_bag(path)
        assert opened.topics["/odd"].type == "odd_msgs/msg/Odd"
        assert contents(opened.messages("/joint_states")) == expected()
        with pytest.raises(
            LogError, match=r"topic /odd: no message can be decoded: type odd_msgs/msg/Odd is no standard"
        ):
            list(opened.messages("/odd"))


def test_channels_of_other_encodings_and_broken_definitions(tmp_path):
    """As in files of other programs: JSON beside CDR, a definition that no parser takes, no profile."""
    file = tmp_path / "mixed.mcap"
    data = b"\x00\x01\x00\x00" + struct.pack("<iI", 12, 500_000_000) + struct.pack("<I", 1) + bytes(4 + 16)
    with file.open("wb") as stream:
        writer = PlainWriter(stream)
        writer.start(profile="", library="another")
        schema = writer.register_schema("foo/Bar", "jsonschema", b"{}")
        odd = writer.register_channel("/json", "json", schema)
        broken = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", b"this is ~ no definition")
        joints = writer.register_channel("/joint_states", "cdr", broken)
        for k in range(3):
            writer.add_message(odd, k, b"{}", k)
            writer.add_message(joints, k, data, k)
        writer.finish()
    opened = open_bag(file)
    assert {topic.name: topic.count for topic in opened.topics.values()} == {"/json": 3, "/joint_states": 3}
    assert [message.stamp for message in opened.messages("/joint_states")] == [12_500_000_000] * 3


def test_times_that_no_clock_shows_are_bounded(tmp_path):
    file = tmp_path / "late.mcap"
    with file.open("wb") as stream:
        writer = PlainWriter(stream)
        writer.start(profile="ros2")
        channel = writer.register_channel("/a", "cdr", writer.register_schema("a/msg/A", "ros2msg", b""))
        for time in (1, 2**63, 2**64 - 1):
            writer.add_message(channel, time, b"", time)
        writer.finish()
    assert open_bag(file).topics["/a"].arrival.tolist() == [1, 2**63 - 1, 2**63 - 1]


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
        assert contents(opened.messages("/joint_states")) == expected()
        assert opened.topics["/joint_states"].count == len(expected())


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


@pytest.mark.parametrize("text", ["", "[", "a: b", "\x00", "rosbag2_bagfile_information: 3"])
def test_metadata_that_is_damaged_matters_little(tmp_path, text):
    folder = write_bag(tmp_path / "run", "sqlite3", MESSAGES)
    (folder / "metadata.yaml").write_text(text)
    opened = open_bag(folder)
    assert contents(opened.messages("/joint_states")) == expected()
    assert "its metadata.yaml is damaged" in opened.notes[0]
    (folder / "metadata.yaml").unlink()
    assert contents(open_bag(folder).messages("/joint_states")) == expected()


@pytest.mark.parametrize("kind", KINDS)
def test_a_recording_that_was_cut_off_is_read_up_to_there(tmp_path, kind):
    log = wandered(duration=30.0)
    path = write_bag(tmp_path / "run", kind, joints_of(log), compression="none" if kind == "foxglove" else None)
    path = file_of(path)
    whole, complete = path.read_bytes(), contents(open_bag(path).messages("/joint_states"))
    assert len(complete) == len(log.time)
    counts = []
    for share in (0.5, 0.7, 0.9):
        cut = tmp_path / f"cut{path.suffix}"
        cut.write_bytes(whole[: int(share * len(whole))])
        opened = open_bag(cut)
        found = contents(opened.messages("/joint_states"))
        rows = [complete.index(one) for one in found]
        assert rows == sorted(set(rows))
        assert kind == "sqlite3" or rows == list(range(len(rows)))  # the pages of a database are in no order
        assert len(opened.notes) == 1
        assert re.search(r"cut\.\w+: .*its end is missing", opened.notes[0])
        counts.append(len(found))
    assert 0 < counts[0] <= counts[1] <= counts[2]


def file_of(path):
    return path if path.is_file() else next(file for file in sorted(path.iterdir()) if file.suffix != ".yaml")


def test_an_unindexed_ros1_bag_is_read(tmp_path):
    """As a recorder leaves it that was killed: the place of the index is 0, and nothing follows the chunks."""
    path = write_bag(tmp_path / "run", "ros1", MESSAGES)
    whole = path.read_bytes()
    place = whole.index(b"index_pos=") + len(b"index_pos=")
    (index,) = struct.unpack_from("<Q", whole, place)
    killed = tmp_path / "run.bag.active"
    killed.write_bytes(whole[:place] + bytes(8) + whole[place + 8 : index])
    opened = open_bag(killed)
    assert opened.name == "run"
    assert contents(opened.messages("/joint_states")) == expected()
    assert "its end is missing" in opened.notes[0]


def test_a_damaged_first_chunk_leaves_the_others(tmp_path):
    for kind, mark in (("ros1", b"compression=lz4"), ("foxglove", b"lz4")):
        path = write_bag(tmp_path / f"{kind}run", kind, in_order(*[MESSAGES] * 20), compression="lz4")
        whole = bytearray(path.read_bytes())
        place = whole.index(mark) + 200
        whole[place : place + 40] = bytes(40)
        path.write_bytes(whole)
        opened = open_bag(path)
        found = contents(opened.messages("/joint_states"))
        assert 0 < len(found) < 20 * len(expected())
        assert any("chunk" in note for note in opened.notes)


def test_a_wrong_checksum_is_told(tmp_path):
    path = write_bag(tmp_path / "run", "foxglove", MESSAGES, compression="none")
    whole = bytearray(path.read_bytes())
    whole[whole.index(b"left_wheel") + 3] ^= 1
    path.write_bytes(whole)
    assert "a chunk has a wrong checksum" in open_bag(path).notes[0]


def test_a_message_that_cannot_be_decoded_is_left_out(tmp_path):
    folder = write_bag(tmp_path / "run", "sqlite3", MESSAGES)
    with sqlite3.connect(folder / "run.db3") as database:
        database.execute("UPDATE messages SET data = x'0001000000' WHERE id = 1")
    notes = []
    found = contents(open_bag(folder).messages("/joint_states", notes=notes))
    assert found == expected()[1:]
    assert notes == [f"topic /joint_states: 1 of {len(expected())} messages left out: {notes[0].partition('out: ')[2]}"]


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1))
def test_damage_never_ends_in_a_traceback(damaged, seed):
    rng = np.random.default_rng(seed)
    whole, file = damaged[rng.choice(sorted(damaged))]
    content = bytearray(whole.read_bytes())
    for _ in range(rng.integers(1, 7)):
        place = rng.integers(len(content))
        content[place : place + 8] = rng.bytes(rng.integers(1, 9))
    file.write_bytes(content[: rng.integers(len(content) + 1)] if rng.random() < 0.5 else content)
    said = ""
    try:
        opened = open_bag(file)
        for topic in opened.topics:
            assert all(message.topic == topic for message in opened.messages(topic))
    except TrackslipError as error:
        said = str(error)
    assert not said or (file.name in said and "\n" not in said)


@pytest.fixture(scope="module")
def damaged(tmp_path_factory):
    folder = tmp_path_factory.mktemp("damaged")
    few = MESSAGES[:60]
    found = {}
    for kind, compression in [
        *((kind, None) for kind in KINDS),
        ("ros1", "bz2"),
        ("mcap", "file"),
        ("sqlite3", "message"),
    ]:
        path = file_of(write_bag(folder / f"{kind}{compression}", kind, few, compression=compression))
        found[f"{kind} {compression}"] = path, folder / f"x{''.join(path.suffixes)}"
    return found


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("none.mcap", None, "none.mcap: no such file or folder"),
        ("empty.mcap", b"", "empty.mcap: is no MCAP file"),
        ("empty.bag", b"", "empty.bag: is no ROS 1 bag of version 2.0"),
        ("old.bag", b"#ROSBAG V1.2\n", "old.bag: is no ROS 1 bag of version 2.0"),
        ("empty.db3", b"", "empty.db3: is no SQLite database"),
        ("text.txt", b"hello", "text.txt: is no bag"),
        ("head.mcap", b"\x89MCAP0\r\n", r"head.mcap: no message can be read \(its end is missing"),
    ],
)
def test_what_is_no_bag_is_refused(tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(LogError, match=message):
        open_bag(tmp_path / name)


def test_a_database_of_something_else_and_a_folder_without_bags(tmp_path):
    with sqlite3.connect(tmp_path / "other.db3") as database:
        database.execute("CREATE TABLE a (b)")
    with pytest.raises(LogError, match=r"other\.db3: is no ROS 2 bag, or damaged"):
        open_bag(tmp_path / "other.db3")
    (tmp_path / "folder").mkdir()
    with pytest.raises(LogError, match=r"folder: holds no bag"):
        open_bag(tmp_path / "folder")


def test_an_unknown_topic_is_refused_with_the_known_ones(tmp_path):
    opened = open_bag(write_bag(tmp_path / "run", "mcap", MESSAGES))
    with pytest.raises(
        LogError, match=r"it has no topic '/scan'; its topics are /joint_states \(sensor_msgs/.*, /slam/pose"
    ):
        opened.topic("/scan")
    assert opened.topic("joint_states").name == "/joint_states"


def test_bags_in_a_folder_that_cannot_be_read_are_named(tmp_path):
    write_bag(tmp_path / "good", "foxglove", MESSAGES)
    (tmp_path / "bad.mcap").write_bytes(b"nothing")
    (opened,) = open_bags(tmp_path)
    assert opened.name == "good"
    assert opened.notes == (f"{tmp_path / 'bad.mcap'}: is no MCAP file",)


def test_stamps_are_those_of_the_header(tmp_path):
    path = write_bag(tmp_path / "run", "mcap", [pose_stamped(START + 7, (1.0, 2.0, 3.0), late=5)])
    (message,) = open_bag(path).messages("/slam/pose")
    assert (message.stamp, message.arrival) == (START + 7, START + 12)
    assert header(START + 7)["stamp"]["nanosec"] == 7
