"""Bags that are damaged, cut off or no bags: read as far as they go, or refused in one line."""

import re
import sqlite3
import struct

import numpy as np
import pytest
from bags import KINDS, contents, expected, in_order, joints_of, poses_of, write_bag
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from wandered import wandered

from trackslip.errors import LogError, TrackslipError
from trackslip.ros.bag import open_bag, open_bags

LOG = wandered(duration=6.0)

MESSAGES = in_order(joints_of(LOG), poses_of(LOG))


@pytest.mark.parametrize("text", ["", "[", "a: b", "\x00", "rosbag2_bagfile_information: 3"])
def test_metadata_that_is_damaged_matters_little(tmp_path, text):
    folder = write_bag(tmp_path / "run", "sqlite3", MESSAGES)
    (folder / "metadata.yaml").write_text(text)
    opened = open_bag(folder)
    assert contents(opened.messages("/joint_states")) == expected(MESSAGES)
    assert "its metadata.yaml is damaged" in opened.notes[0]
    (folder / "metadata.yaml").unlink()
    assert contents(open_bag(folder).messages("/joint_states")) == expected(MESSAGES)


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
    assert contents(opened.messages("/joint_states")) == expected(MESSAGES)
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
        assert 0 < len(found) < 20 * len(expected(MESSAGES))
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
    assert found == expected(MESSAGES)[1:]
    assert notes == [
        f"topic /joint_states: 1 of {len(expected(MESSAGES))} messages left out: {notes[0].partition('out: ')[2]}"
    ]


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
        ("empty.mcap", b"", r"empty.mcap: no message can be read \(is no bag"),
        ("empty.bag", b"", r"empty.bag: no message can be read \(is no bag"),
        ("old.bag", b"#ROSBAG V1.2\n", r"old.bag: no message can be read \(is no bag of ROS 1 .version 2.0."),
        ("empty.db3", b"", r"empty.db3: no message can be read \(is no bag"),
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
    with pytest.raises(LogError, match=r"other\.db3: no message can be read .is no ROS 2 bag, or damaged"):
        open_bag(tmp_path / "other.db3")
    (tmp_path / "folder").mkdir()
    with pytest.raises(LogError, match=r"folder: holds no bag"):
        open_bag(tmp_path / "folder")


def test_bags_in_a_folder_that_cannot_be_read_are_named(tmp_path):
    write_bag(tmp_path / "good", "foxglove", MESSAGES)
    (tmp_path / "bad.mcap").write_bytes(b"nothing")
    (opened,) = open_bags(tmp_path)
    assert opened.name == "good"
    (note,) = opened.notes
    assert "bad.mcap: no message can be read (is no bag" in note
