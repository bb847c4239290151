import bz2
import os
import sys
from pathlib import Path

import pytest
from backports import zstd
from lz4 import frame

from trackslip import memory
from trackslip.errors import InvalidValueError, LogError
from trackslip.memory import half_of_memory, parse_size, require_fits, size_text, unpacked_size

PACKED = {
    "bz2": (bz2.compress, bz2.BZ2Decompressor),
    "lz4": (frame.compress, frame.LZ4FrameDecompressor),
    "zstd": (zstd.compress, zstd.ZstdDecompressor),
}
SIZE = 5_000_000


@pytest.mark.parametrize("kind", PACKED)
@pytest.mark.parametrize("pieces", [1, 7])
def test_a_stream_is_counted_to_its_end(kind, pieces):
    compress, decompressor = PACKED[kind]
    packed = compress(bytes(SIZE))
    length = len(packed) // pieces + 1
    parts = [packed[k : k + length] for k in range(0, len(packed), length)]
    assert unpacked_size(decompressor(), parts, 2 * SIZE) == SIZE


@pytest.mark.parametrize("kind", PACKED)
def test_counting_stops_above_the_limit(kind):
    compress, decompressor = PACKED[kind]
    counted = unpacked_size(decompressor(), [compress(bytes(SIZE))], 1_500_000)
    assert 1_500_000 < counted <= 2_500_000


@pytest.mark.parametrize("kind", PACKED)
def test_a_second_stream_behind_the_first_is_refused(kind):
    compress, decompressor = PACKED[kind]
    packed = compress(bytes(10))
    for parts in ([packed + packed], [packed, packed]):
        with pytest.raises(ValueError, match="data after the end"):
            unpacked_size(decompressor(), parts, SIZE)


def test_what_needs_more_memory_than_allowed_is_refused():
    require_fits("log", 100, 100)
    message = r"^log: reading it may take 101 bytes of memory or more, must be at most 100 bytes"
    with pytest.raises(LogError, match=message):
        require_fits("log", 101, 100)


def test_half_of_the_least_limit_is_the_default(monkeypatch):
    monkeypatch.setattr(memory, "_physical_memory", lambda: 1000)
    monkeypatch.setattr(memory, "_container_limit", lambda: [600])
    monkeypatch.setattr(memory, "_process_limit", list)
    assert half_of_memory() == 300
    monkeypatch.setattr(memory, "_process_limit", lambda: [100])
    assert half_of_memory() == 50


@pytest.mark.parametrize(("text", "half"), [("5000\n", 2500), ("max\n", 5000), (None, 5000)])
def test_a_container_limits_memory_if_it_says_so(tmp_path, monkeypatch, text, half):
    file = tmp_path / "memory.max"
    if text is not None:
        file.write_text(text)
    monkeypatch.setattr(memory, "_physical_memory", lambda: 10_000)
    monkeypatch.setattr(memory, "_process_limit", list)
    monkeypatch.setattr(memory, "_CONTAINER_LIMIT", file)
    assert half_of_memory() == half


def test_the_soft_limit_of_ulimit_counts_unless_infinite(monkeypatch):
    resource = pytest.importorskip("resource")
    monkeypatch.setattr(memory, "_physical_memory", lambda: 10_000)
    monkeypatch.setattr(memory, "_container_limit", list)
    for soft, half in ((7000, 3500), (resource.RLIM_INFINITY, 5000)):
        monkeypatch.setattr(resource, "getrlimit", lambda _, soft=soft: (soft, 9000))
        assert half_of_memory() == half


def test_windows_has_neither_limits_nor_sysconf(monkeypatch):
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setitem(sys.modules, "resource", None)  # importing it would raise
    monkeypatch.setattr(memory, "_CONTAINER_LIMIT", Path("nowhere/memory.max"))
    monkeypatch.delattr(os, "sysconf", raising=False)
    assert half_of_memory() == 4_000_000_000


@pytest.mark.skipif(not Path("/proc/meminfo").exists(), reason="Linux tells its memory there")
def test_without_limits_half_of_the_machines_memory_counts(monkeypatch):
    monkeypatch.setattr(memory, "_container_limit", list)
    monkeypatch.setattr(memory, "_process_limit", list)
    kibibytes = int(Path("/proc/meminfo").read_text().split()[1])
    assert half_of_memory() == pytest.approx(1024 * kibibytes / 2, rel=1e-3)


@pytest.mark.parametrize(
    ("size", "text"),
    [(0, "0 bytes"), (999, "999 bytes"), (11_900_000_000, "11.9 GB"), (10**18, "1000000 TB")],
)
def test_sizes_are_told_in_the_largest_unit(size, text):
    assert size_text(size) == text


@pytest.mark.parametrize(
    ("text", "size"), [("8GB", 8 * 10**9), ("1.5 gb", 1_500_000_000), ("500MB", 500_000_000)]
)
def test_sizes_have_a_number_and_a_unit(text, size):
    assert parse_size("max_memory", text) == size


@pytest.mark.parametrize("text", ["", "8", "GB", "8G", "-8GB", "0GB", "nanGB", "infGB", "1KB"])
def test_texts_that_are_no_sizes_are_refused(text):
    with pytest.raises(InvalidValueError, match=r"^max_memory = .*: must be a size of at least 1"):
        parse_size("max_memory", text)
