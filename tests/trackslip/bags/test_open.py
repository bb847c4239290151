import shutil
import stat
import sys

import numpy as np
import pytest
from bags import (
    JOINTS,
    KINDS,
    contents,
    expected,
    in_order,
    joints_of,
    open_bag,
    poses_of,
    store,
    write_bag,
)
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from plain_drives import wandered
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import trackslip
from trackslip.bags.open import open_bags
from trackslip.errors import LogError, TrackslipError

COMPRESSED = [("ros1", "lz4"), ("sqlite3", "message"), ("mcap", "storage"), ("foxglove", "zstd")]
LOG = wandered(duration=6.0)
MESSAGES = in_order(joints_of(LOG), poses_of(LOG))
LONG = wandered(duration=30.0)


def file_of(path):
    """The file of a bag, which is one or a folder with one besides the metadata."""
    if path.is_file():
        return path
    return next(file for file in sorted(path.iterdir()) if file.suffix != ".yaml")


@pytest.mark.parametrize(("kind", "compression"), [*((kind, None) for kind in KINDS), *COMPRESSED])
def test_every_message_comes_back_with_every_bit(tmp_path, kind, compression):
    """Types that nobody knows are in nobody's way."""
    odd = []
    for *_, at, _ in MESSAGES[::7]:
        odd.append(("/odd", "odd_msgs/msg/Odd", at, {"text": "x", "what": [1, 2]}))
    path = write_bag(tmp_path / "run", kind, in_order(MESSAGES, odd), compression=compression)
    bag = open_bag(path)
    assert contents(bag.messages("joint_states")) == expected(MESSAGES)
    assert bag.first("/odd", 1)[0].content.text == "x"
    assert bag.name == "run"
    assert bag.notes == ()
    topics = {name: (topic.type, topic.count) for name, topic in bag.topics.items()}
    with AnyReader([path]) as reader:
        by_rosbags = {name: (each.msgtype, each.msgcount) for name, each in reader.topics.items()}
    assert topics == by_rosbags
    times = [at for topic, _, at, _ in MESSAGES if topic == "/slam/pose"]
    np.testing.assert_array_equal(bag.arrivals()["/slam/pose"], times)


@pytest.mark.parametrize("text", ["", "a: b"])
def test_metadata_that_is_damaged_is_refused_and_not_needed(tmp_path, text):
    folder = write_bag(tmp_path / "run", "sqlite3", MESSAGES)
    (folder / "metadata.yaml").write_text(text)
    said = r"run: can't be read \(.*may repair it: ros2 bag reindex \S*run$"
    with pytest.raises(LogError, match=said):
        open_bags(folder)
    (folder / "metadata.yaml").unlink()
    assert contents(open_bag(folder).messages("/joint_states")) == expected(MESSAGES)


def test_a_split_recording_is_one_bag_by_its_metadata(tmp_path):
    folder = write_bag(tmp_path / "run", "mcap", MESSAGES[:100])
    rest = write_bag(tmp_path / "more", "mcap", MESSAGES[100:])
    shutil.copy(file_of(rest), folder / "run_1.mcap")
    about = folder / "metadata.yaml"
    about.write_text(about.read_text().replace("- run.mcap", "- run.mcap\n  - run_1.mcap"))
    assert contents(open_bag(folder).messages("/joint_states")) == expected(MESSAGES)
    (folder / "run_1.mcap").unlink()
    with pytest.raises(LogError, match=r"run_1\.mcap.*ros2 bag reindex"):
        open_bags(folder)


@pytest.mark.parametrize(("share", "compression"), [(0.3, "none"), (0.7, "zstd")])
def test_an_mcap_file_that_was_cut_off_is_read_up_to_there(tmp_path, share, compression):
    messages = joints_of(LONG)
    path = write_bag(tmp_path / "run", "foxglove", messages, compression=compression)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    bag = open_bag(path)
    rows = contents(bag.messages("/joint_states"))
    assert 0 < len(rows) < len(messages)
    assert rows == expected(messages)[: len(rows)]
    assert len(bag.arrivals()["/joint_states"]) == len(rows)
    (note,) = bag.notes
    assert "its end is missing, as after a power cut: read as far as it goes" in note


@pytest.mark.parametrize(
    ("kind", "command"),
    [
        ("ros1", "rosbag reindex {file}"),
        ("sqlite3", "sqlite3 {file} .recover | sqlite3 NEW.db3"),
        ("foxglove", "mcap recover {file} -o NEW.mcap"),
    ],
)
def test_damage_is_refused_with_the_command_that_repairs(tmp_path, kind, command):
    compression = None if kind == "sqlite3" else "lz4"
    bag = write_bag(tmp_path / "run", kind, joints_of(LONG), compression=compression)
    path = file_of(bag)
    whole = bytearray(path.read_bytes())
    middle = len(whole) // 3
    whole[middle : middle + 3000] = bytes(3000)
    path.write_bytes(whole)
    with pytest.raises(LogError) as refused:
        list(open_bag(path).messages("/joint_states"))
    assert str(refused.value).startswith(f"{path}: can't be read (")
    assert str(refused.value).endswith(f"); this may repair it: {command.format(file=path)}")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("none.mcap", None, "none.mcap: no such file or folder"),
        ("empty.mcap", b"", r"empty.mcap: can't be read \(it has no whole message\)"),
        (
            "old.bag",
            b"#ROSBAG V1.2\n",
            r"old.bag: can't be read \(it begins with .*V1.2.*, must begin with .*V2.0",
        ),
        ("empty.db3", b"", r"empty.db3: can't be read \(Cannot open database .* missing tables\)"),
        ("text.txt", b"hello", "text.txt: is no bag"),
    ],
)
def test_what_is_no_bag_is_refused(tmp_path, name, content, message):
    (tmp_path / "folder").mkdir()
    with pytest.raises(LogError, match=r"folder: holds no bag"):
        open_bag(tmp_path / "folder")
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(LogError, match=message):
        open_bag(tmp_path / name)


@pytest.fixture(scope="module")
def damaged(tmp_path_factory):
    folder = tmp_path_factory.mktemp("damaged")
    found = {}
    plain = [(kind, None) for kind in KINDS]
    for kind, compression in (*plain, ("ros1", "bz2"), ("sqlite3", "message")):
        bag = folder / f"{kind}{compression}"
        whole = file_of(write_bag(bag, kind, MESSAGES[:60], compression=compression))
        found[f"{kind} {compression}"] = whole, folder / f"x{''.join(whole.suffixes)}"
    return found


@settings(
    max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(seed=st.integers(0, 2**32 - 1))
def test_damage_never_ends_in_a_traceback(damaged, seed):
    rng = np.random.default_rng(seed)
    whole, file = damaged[rng.choice(sorted(damaged))]
    content = bytearray(whole.read_bytes())
    for _ in range(rng.integers(1, 7)):
        place = rng.integers(len(content))
        content[place : place + 8] = rng.bytes(rng.integers(1, 9))
    if rng.random() < 0.5:
        content = content[: rng.integers(len(content) + 1)]
    file.write_bytes(content)
    said = ""
    try:
        bag = open_bag(file)
        for topic in bag.topics:
            assert all(message.topic == topic for message in bag.messages(topic))
    except TrackslipError as error:
        said = str(error)
    assert "\n" not in said
    assert not said or file.name in said


LATE = (
    "odd_msgs/Header header\nfloat64 value\n"
    f"{80 * '='}\nMSG: odd_msgs/Header\nodd_msgs/Stamp stamp\n"
    f"{80 * '='}\nMSG: odd_msgs/Stamp\nint64 sec\nuint32 nanosec\n"
)


def test_a_stamp_beyond_2116_is_refused_in_one_line(tmp_path):
    """Differences of such stamps may not fit in 64 bits; a bag may define seconds of 64 bits."""
    types = get_typestore(Stores.ROS2_JAZZY)
    types.register(get_types_from_msg(LATE, "odd_msgs/msg/Late"))
    stamp = types.types["odd_msgs/msg/Stamp"](2**62 // 10**9 + 1, 0)
    header = types.types["odd_msgs/msg/Header"](stamp)
    message = types.types["odd_msgs/msg/Late"](header, 1.0)
    folder = tmp_path / "late"
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/late", "odd_msgs/msg/Late", typestore=types)
        writer.write(connection, 1, types.serialize_cdr(message, "odd_msgs/msg/Late"))
    said = r"^topic /late: a header stamp is 4611686019000000000 ns: must be below 2\^62 ns"
    with pytest.raises(LogError, match=said):
        open_bag(folder).table("/late", lambda content: (content.value,))


def test_a_message_unlike_its_type_is_refused_in_one_line(tmp_path):
    folder = tmp_path / "odd"
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/joint_states", JOINTS, typestore=store(False))
        writer.write(connection, 1, b"\0\1\0\0" + bytes(range(40)))
    with pytest.raises(LogError, match=r"odd: can't be read \(.*") as refused:
        list(open_bag(folder).messages("/joint_states"))
    assert "\n" not in str(refused.value)


def test_a_packed_file_is_unpacked_into_a_private_folder(tmp_path, monkeypatch):
    elsewhere = tmp_path / "temporary"
    elsewhere.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(elsewhere))
    folder = write_bag(tmp_path / "run", "sqlite3", MESSAGES, compression="file")
    messages = open_bag(folder).messages("/joint_states")
    next(messages)
    (private,) = elsewhere.iterdir()
    assert stat.S_IMODE(private.stat().st_mode) == 0o700
    messages.close()
    assert not any(elsewhere.iterdir())


def test_without_rosbags_one_line_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    bag = write_bag(tmp_path / "run", "mcap", MESSAGES)
    said = r'bags need the package rosbags: pip install -e "\.\[ros\]"'
    with pytest.raises(TrackslipError, match=said):
        trackslip.load(bag)
