"""Small files that unpack to far more than they weigh, and a reader with little memory for them."""

import io
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from backports import zstd
from bags import JOINTS, write_bag
from mcap.reader import make_reader
from mcap.records import Footer
from mcap.stream_reader import MAGIC_SIZE
from mcap.writer import CompressionType, Writer

from trackslip.bags.size import MCAP_MAGIC

NUMBERS = ("t", "omega_l", "omega_r", "x", "y", "phi")
LITTLE = 100_000_000
"""Limit for the files below, each of which unpacks to more [bytes]."""
PLENTY = 4_000_000_000
"""Address space of the process that reads them [bytes]."""

_READ = """
import resource, sys
from trackslip.bags.drives import load
from trackslip.errors import LogError
resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[2]),) * 2)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for path in sys.argv[3:]:
    try:
        load(path, max_memory=int(sys.argv[1]))
    except LogError as error:
        print(error)
print(1000 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before))
"""


def read_with_little_memory(*paths):
    """Load logs in another process; returns the message for each and the memory taken [bytes]."""
    arguments = [sys.executable, "-c", _READ, str(LITTLE), str(PLENTY), *map(str, paths)]
    done = subprocess.run(arguments, capture_output=True, text=True, check=True)
    *messages, taken = done.stdout.splitlines()
    return messages, int(taken)


def table(rows, **columns):
    return pa.table({name: np.zeros(rows) for name in NUMBERS} | columns)


def repeated_numbers(path):
    pq.write_table(table(1_000_000), path, row_group_size=1_000_000)
    return path


def repeated_text(path):
    text = pa.DictionaryArray.from_arrays(np.zeros(10_000, np.int32), ["x" * 100_000])
    pq.write_table(table(10_000, run=text), path)
    return path


def long_lists(path):
    nothing = pa.nulls(10_000_000, pa.float32())
    lists = pa.ListArray.from_arrays(pa.array([0, len(nothing)], pa.int32()), nothing)
    pq.write_table(table(1, ranges=lists), path)
    return path


def empty_rows(path):
    path.write_text("t,omega_l,omega_r,phi\n" + 400_000 * ",,,\n")
    return path


def mcap(path, *messages, definition="float64[] position", compression="zstd", together=True):
    """Write messages, given as CDR, to a file; all in a chunk or each in a chunk of its own."""
    with path.open("wb") as file:
        chunk_size = sum(map(len, messages)) + 1_000_000 if together else 1
        packing = CompressionType[compression.upper()]
        writer = Writer(file, chunk_size=chunk_size, compression=packing)
        writer.start("ros2")
        schema = writer.register_schema(JOINTS, "ros2msg", definition.encode())
        channel = writer.register_channel("/joint_states", "cdr", schema)
        for k, message in enumerate(messages):
            writer.add_message(channel, log_time=k, data=message, publish_time=k)
        writer.finish()
    return path


def with_repeated_chunks(path, count):
    """List the chunks of an MCAP file `count` times in its summary."""
    content = path.read_bytes()
    summary = make_reader(io.BytesIO(content)).get_summary()
    start = make_footer_start(content)
    from mcap.data_stream import RecordBuilder

    records = RecordBuilder()
    for record in (*summary.schemas.values(), *summary.channels.values(), summary.statistics):
        record.write(records)
    for _ in range(count):
        for chunk in summary.chunk_indexes:
            chunk.write(records)
    Footer(summary_start=start, summary_offset_start=0, summary_crc=0).write(records)
    path.write_bytes(content[:start] + records.end() + MCAP_MAGIC)
    return path


def make_footer_start(content):
    """Position of the summary of an MCAP file."""
    return int.from_bytes(content[-20 - MAGIC_SIZE :][:8], "little")


def packed_file(folder):
    """A folder whose .db3 file, compressed as a whole, unpacks to zeros."""
    message = ("/joint_states", JOINTS, 1, {})
    folder = write_bag(folder, "sqlite3", [message], compression="file")
    (file,) = folder.glob("*.zstd")
    file.write_bytes(zstd.compress(bytes(2 * LITTLE)))
    return folder


def packed_message(folder):
    """A folder with a message, compressed alone, of zeros."""
    message = ("/joint_states", JOINTS, 1, {"position": np.zeros(LITTLE // 8)})
    return write_bag(folder, "sqlite3", [message], compression="message")


def ros1(path, compression):
    """A ROS 1 bag with a compressed chunk of zeros."""
    message = ("/joint_states", JOINTS, 1, {"position": np.zeros(LITTLE // 8)})
    return write_bag(Path(path), "ros1", [message], compression=compression)
