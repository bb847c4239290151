"""Bags that cannot be written leave nothing behind."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from full_log import ROWS, full_log

from trackslip.errors import InvalidValueError, OutputError, TrackslipError
from trackslip.ros import messages
from trackslip.ros.writer import write_bag


@pytest.fixture
def log():
    return full_log()


def test_an_interrupted_bag_leaves_nothing(log, tmp_path, monkeypatch):
    def stopped(self, stamps, frame):
        yield from ()
        raise KeyboardInterrupt

    monkeypatch.setattr(messages.Messages, "_headers", stopped)
    with pytest.raises(KeyboardInterrupt):
        write_bag(log, tmp_path / "bag")
    assert list(tmp_path.iterdir()) == []


def test_refusals(log, tmp_path):
    (tmp_path / "there").mkdir()
    with pytest.raises(OutputError, match=r"there: exists already$"):
        write_bag(log, tmp_path / "there")
    (tmp_path / "file").touch()
    seen = replace(log.scans.scan, ranges=log.scans.full)
    with pytest.raises(OutputError, match=r"bag: can't be written \(.+\)$"):
        write_bag(log, tmp_path / "file" / "bag")
    for given, message in (
        ({"poses": "Pose"}, "poses = 'Pose': must be one of PoseWithCovarianceStamped, PoseStamped, Odometry"),
        ({"readings": np.ones(3, bool)}, "readings = (3,): must be of shape (40,)"),
        ({"readings": np.zeros(ROWS, bool)}, "readings = 'false everywhere': must be true in at least one row"),
        ({"covariance": np.ones(3)}, "covariance = (3,): must be of shape (3, 3)"),
        ({"scans": (log.time[:3], seen)}, "scans = '3 times': must be 40, one per scan"),
        ({"scans": (-log.time, seen)}, 'scans = "times that don\'t ascend": must be in order of time'),
        ({"start": -(10**9)}, "start = -1000000000: must be such that all stamps are from 0 to 2147483647 s"),
    ):
        with pytest.raises(InvalidValueError) as refusal:
            write_bag(log, tmp_path / "bag", **given)
        assert str(refusal.value) == message
    assert not (tmp_path / "bag").exists()


def test_without_rosbags(log, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(TrackslipError, match=r"^bags need the package rosbags: pip install 'trackslip\[ros\]'$"):
        write_bag(log, tmp_path / "bag")
