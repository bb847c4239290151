"""Bags that unpack to more than is allowed are refused before they are unpacked."""

import io
import sqlite3
import struct

import numpy as np
import pytest
from bags import JOINTS, in_order, joints_of, write_bag
from bombs import (
    LITTLE,
    mcap,
    packed_file,
    packed_message,
    read_with_little_memory,
    ros1,
    with_repeated_chunks,
)
from mcap.reader import make_reader
from plain_drives import wandered
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from trackslip.bags.drives import load
from trackslip.bags.open import open_bags
from trackslip.bags.size import memory_per_byte, require_bag_fits, require_definitions_fit
from trackslip.errors import LogError

CDR = b"\0\1\0\0"
SEPARATOR = 80 * "=" + "\n"
MESSAGE = ("/joint_states", JOINTS, 1, {})


def types_of(*definitions):
    """The fields of messages a/msg/A, a/msg/B, ... by name, as rosbags parses them."""
    store = get_typestore(Stores.EMPTY)
    parts = [f"MSG: a/{'BCDEFGH'[k]}\n{text}" for k, text in enumerate(definitions[1:])]
    text = f"\n{SEPARATOR}".join([definitions[0], *parts])
    store.register(get_types_from_msg(text, "a/msg/A"))
    return store.fielddefs


def refusal(path, max_memory=LITTLE):
    """The message with which a bag is refused when it is opened or when its joints are read."""
    with pytest.raises(LogError) as refused:
        list(open_bags(path, max_memory)[0].messages("/joint_states"))
    return str(refused.value)


def test_bags_are_refused_before_their_memory_is_taken(tmp_path):
    zeros = CDR + bytes(LITTLE)
    paths = [
        mcap(tmp_path / "zstd.mcap", zeros),
        mcap(tmp_path / "lz4.mcap", zeros, compression="lz4"),
        ros1(tmp_path / "bz2.bag", "bz2"),
        ros1(tmp_path / "lz4.bag", "lz4"),
        packed_file(tmp_path / "file"),
        packed_message(tmp_path / "message"),
        with_repeated_chunks(mcap(tmp_path / "index.mcap", CDR + bytes(1_000_000)), 1000),
    ]
    messages, taken = read_with_little_memory(*paths)
    assert taken < 2 * LITTLE
    for path, message in zip(paths, messages, strict=True):
        assert message.startswith(str(path))
        assert message.endswith("of memory or more, must be at most 100 MB (max_memory)")


def test_a_cut_off_file_is_counted_too(tmp_path):
    path = mcap(tmp_path / "run.mcap", CDR + bytes(LITTLE))
    path.write_bytes(path.read_bytes()[:-100])
    assert "reading it may take 112 MB of memory" in refusal(path)


def test_a_chunk_is_read_up_to_its_last_byte(tmp_path, monkeypatch):
    """A byte behind its stream is found, also if that alone is the last piece of the file read."""
    path = mcap(tmp_path / "run.mcap", CDR + bytes(1000))
    content = path.read_bytes()
    (chunk,) = make_reader(io.BytesIO(content)).get_summary().chunk_indexes
    sizes = struct.pack("<QQ", chunk.compressed_size, chunk.uncompressed_size)
    assert content.count(sizes) == 1  # in the index
    longer = struct.pack("<QQ", chunk.compressed_size + 1, chunk.uncompressed_size)
    path.write_bytes(content.replace(sizes, longer))
    monkeypatch.setattr("trackslip.bags.size._PIECE", chunk.compressed_size)
    with pytest.raises(ValueError, match="data after the end of its compressed stream"):
        require_bag_fits(path)


def test_a_list_in_a_message_is_counted_before_it_is_decoded(tmp_path):
    definition = f"Bool[] name\n{SEPARATOR}MSG: sensor_msgs/Bool\nbool data\n"
    message = CDR + struct.pack("<I", 1_000_000) + bytes(1_000_000)
    path = mcap(tmp_path / "run.mcap", message, definition=definition)
    assert "reading it may take 150 MB of memory" in refusal(path)


def test_joints_whose_names_are_no_texts_are_no_joints(tmp_path):
    definition = f"Bool[] name\n{SEPARATOR}MSG: sensor_msgs/Bool\nbool data\n"
    message = CDR + struct.pack("<I", 4) + bytes(4)
    path = mcap(tmp_path / "run.mcap", message, definition=definition)
    with pytest.raises(LogError, match="which of its joints are left and right"):
        load(path)


def test_numbers_are_counted_while_they_are_collected(tmp_path):
    message = CDR + struct.pack("<I", 10_000) + bytes(4) + bytes(80_000)
    path = mcap(tmp_path / "run.mcap", *100 * [message], together=False)
    (bag,) = open_bags(path, 20_000_000)
    stamp = type("Stamp", (), {"sec": 0, "nanosec": 0})
    header = type("Header", (), {"stamp": stamp})
    with pytest.raises(LogError, match=r"reading it may take 20\.\d MB of memory"):
        bag.readings(["/joint_states"], lambda content: [(0, header, content.position)])


def test_chunks_that_follow_each_other_are_not_added_up(tmp_path):
    message = CDR + struct.pack("<I", 10_000) + bytes(4) + bytes(80_000)
    path = mcap(tmp_path / "run.mcap", *100 * [message], together=False)
    (bag,) = open_bags(path, 20_000_000)
    assert sum(1 for _ in bag.messages("/joint_states")) == 100


@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap", "foxglove"])
def test_long_arrays_of_texts_are_refused_before_decoding(tmp_path, kind):
    definition = "string[30000000] name"
    if kind == "foxglove":
        path = mcap(tmp_path / "run.mcap", CDR + bytes(100), definition=definition)
        assert "has 30000000 texts or messages in arrays, must be at most 5000" in refusal(path)
    else:
        types = types_of(definition)
        with pytest.raises(LogError, match="type a/msg/A has 30000000 texts or messages"):
            memory_per_byte(kind, types, "a/msg/A")


@pytest.mark.parametrize(
    ("definitions", "count"),
    [
        (("string[6000] a",), "6000 texts or messages in arrays, must be at most 5000"),
        (("B[100] b", "C[100] c", "D[100] d", "uint8 x"), "1010101 texts or messages"),
        ((*(f"{x} a\n{x} b\n{x} c\n{x} d\n{x} e\n{x} f" for x in "BCDEFGH"), ""), "335923 texts"),
    ],
)
def test_arrays_and_messages_within_each_other_multiply(definitions, count):
    types = types_of(*definitions)
    with pytest.raises(LogError, match=f"run: type a/msg/A has {count}"):
        memory_per_byte("run", types, "a/msg/A")


def test_arrays_of_numbers_take_no_more_than_their_bytes():
    types = types_of("float64[1000000000] a\nstring[100] b")
    assert memory_per_byte("run", types, "a/msg/A") == 150


def test_messages_in_lists_are_counted_with_all_their_parts():
    types = types_of("B[] b", "C c1\nC c2", "D d", "bool x")
    assert memory_per_byte("run", types, "a/msg/A") == 5 * 150


def test_a_type_that_contains_itself_is_refused(tmp_path):
    path = mcap(tmp_path / "run.mcap", CDR + bytes(100), definition="JointState a")
    assert "can't be read" in refusal(path)


def test_definitions_that_take_minutes_to_parse_are_refused():
    with pytest.raises(LogError, match="5000002 characters of message definitions"):
        require_definitions_fit("run", 2 * ["x" * 2_500_001])
    with pytest.raises(LogError, match="50001 lines of message definitions"):
        require_definitions_fit("run", ["x\n" * 50_000, "\n"])
    require_definitions_fit("run", 2 * ["x\n" * 50_000])


def database_of(folder):
    write_bag(folder, "sqlite3", [MESSAGE])
    (file,) = folder.glob("*.db3")
    return file


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            "ALTER TABLE messages ADD COLUMN d GENERATED ALWAYS AS (zeroblob(1000000000))",
            "messages",
        ),
        ("ALTER TABLE messages RENAME TO m; CREATE VIEW messages AS SELECT * FROM m", "messages"),
        ("ALTER TABLE topics RENAME TO m; CREATE VIEW topics AS SELECT * FROM m", "topics"),
    ],
)
def test_a_database_that_computes_rows_is_refused(tmp_path, change, message):
    file = database_of(tmp_path / "run")
    with sqlite3.connect(file) as database:
        database.executescript(change)
    assert f"its table {message} is computed, not stored" in refusal(file)


def test_a_database_with_topics_that_repeat_is_refused(tmp_path):
    file = database_of(tmp_path / "run")
    with sqlite3.connect(file) as database:
        database.executescript(
            "CREATE TABLE m AS SELECT * FROM topics; DROP TABLE topics;"
            "ALTER TABLE m RENAME TO topics; INSERT INTO topics SELECT * FROM topics;"
        )
    assert "several of its topics have the same id" in refusal(file)


def test_yaml_with_aliases_is_refused(tmp_path):
    folder = write_bag(tmp_path / "run", "mcap", [MESSAGE])
    metadata = folder / "metadata.yaml"
    metadata.write_text("a: &a {x: 1}\nb: {<<: [*a, *a]}\n" + metadata.read_text())
    assert refusal(folder).endswith("YAML with an alias (*a), which no recorder writes")
    file = database_of(tmp_path / "other")
    with sqlite3.connect(file) as database:
        database.execute("UPDATE topics SET offered_qos_profiles = 'a: &a 1\nb: *a'")
    assert refusal(file).endswith("YAML with an alias (*a), which no recorder writes")


def test_metadata_that_lists_a_file_twice_is_refused(tmp_path):
    folder = write_bag(tmp_path / "run", "mcap", [MESSAGE])
    metadata = folder / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("- run.mcap", "- run.mcap\n  - x/run.mcap"))
    assert refusal(folder).endswith("lists a file several times")


def test_a_packed_file_must_fit_on_the_disk(tmp_path, monkeypatch):
    usage = type("Usage", (), {"free": 1_000_000})
    monkeypatch.setattr("trackslip.bags.size.shutil.disk_usage", lambda _: usage)
    folder = packed_file(tmp_path / "run")
    assert "unpacks to more than the 500 KB free in" in refusal(folder)


@pytest.mark.parametrize(
    ("kind", "compression"),
    [
        ("ros1", "bz2"),
        ("ros1", "lz4"),
        ("sqlite3", "file"),
        ("sqlite3", "message"),
        ("mcap", "file"),
        ("mcap", "storage"),
        ("foxglove", "lz4"),
    ],
)
def test_honest_bags_are_read_with_little_memory(tmp_path, kind, compression):
    messages = joints_of(wandered(duration=30.0))
    path = write_bag(tmp_path / "run", kind, in_order(messages), compression=compression)
    (bag,) = open_bags(path, 10_000_000)
    assert sum(1 for _ in bag.messages("/joint_states")) == len(messages)
    assert len(np.unique(bag.arrivals()["/joint_states"])) == len(messages)
