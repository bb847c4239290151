"""File names for runs."""

from __future__ import annotations

from experiments.storage.file_names import file_names


def test_file_names():
    assert file_names(["radius=0.5 speed=0.1", "a/b", "a b", "..", "x" * 300], ".rrd") == [
        "radius=0.5_speed=0.1.rrd",
        "a_b.rrd",
        "a_b_2.rrd",
        "run.rrd",
        "x" * 120 + ".rrd",
    ]
