"""`trackslip plan`: what it writes, and a second round."""

from __future__ import annotations

import csv
import json
import sys

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from trackslip.planning import plan as planning

ROBOT = ("--half-gauge", "0.168", "--sprocket-radius", "0.06")
SHORT = (*ROBOT, "--duration", "30", "--threads", "1")


@pytest.fixture(autouse=True)
def few_routes(monkeypatch):
    """A search of a quarter of a second."""
    monkeypatch.setattr(planning, "_EVALUATIONS", 30)
    monkeypatch.setattr(planning, "_FEWEST", 30)


def test_it_writes_a_plan_as_a_table_and_a_bag(trackslip):
    result = trackslip("plan", *SHORT, "--topic", "/base/cmd_vel")
    with (result.folder / "plan.csv").open(newline="") as stream:
        header, *rows = csv.reader(stream)
    assert header == ["t", "omega_l", "omega_r", "v", "w"]
    t, left, right, v, w = np.array(rows, float).T
    np.testing.assert_allclose(np.diff(t), 0.02, atol=1e-6)
    np.testing.assert_allclose(v, 0.06 * (left + right) / 2, atol=1e-5)
    np.testing.assert_allclose(w, 0.06 * (right - left) / (2 * 0.168), atol=1e-4)
    assert max(np.abs(left).max(), np.abs(right).max()) * 0.06 <= 0.3 + 1e-6
    with AnyReader([result.folder / "bags" / "cmd_vel.mcap"]) as reader:
        (connection,) = reader.connections
        assert (connection.topic, connection.msgtype) == ("/base/cmd_vel", "geometry_msgs/msg/TwistStamped")
        sent = [(1e-9 * at, reader.deserialize(raw, connection.msgtype)) for _, at, raw in reader.messages()]
    assert {(one.header.stamp.sec, one.header.stamp.nanosec) for _, one in sent} == {(0, 0)}  # the time of arrival
    np.testing.assert_allclose(np.array([at for at, _ in sent]) - sent[0][0], t, atol=1e-5)
    np.testing.assert_allclose(
        [(one.twist.linear.x, one.twist.angular.z) for _, one in sent], np.column_stack([v, w]), atol=1e-4
    )
    assert (result.folder / "figures" / "plan.svg").exists()
    report = (result.folder / "report.html").read_text()
    assert all(words in report for words in ("A drive to identify slip", "the paper&#39;s 25 runs", "Share: "))
    assert "the paper's 25 runs" in result.printed


def test_without_rosbags_a_line_says_that_the_bag_is_left_out(trackslip, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    result = trackslip("plan", *SHORT)
    assert "no ROS 2 bag of the commands, as the package rosbags is missing" in result.printed
    assert (result.folder / "plan.csv").exists()
    assert not (result.folder / "bags").exists()


@pytest.fixture
def known(tmp_path):
    """A stored identification, in the folder `known`."""
    law = {"values": {"offset": 0.04, "radius_error": 0.01}, "stderr": {"offset": 1e-3, "radius_error": 1e-3}}
    geometry = {"half_gauge": 0.168, "sprocket_radius": 0.06}
    (tmp_path / "known").mkdir()
    content = {"format": 1, "geometry": geometry, "slip_laws": {"icr_radius": law}}
    (tmp_path / "known" / "summary.json").write_text(json.dumps(content))
    return tmp_path / "known"


def test_a_second_round(trackslip, known):
    result = trackslip("plan", "--after", str(known), "--duration", "20", "--no-bag")
    assert result.summary["values"] == {"offset": 0.04, "radius_error": 0.01}
    assert result.summary["stderr"]["radius_error"] < 1e-3
    assert result.summary["knowledge"]["reach_doubt"] == pytest.approx(4e-3 / 0.208)
    assert not (result.folder / "bags").exists()


@pytest.mark.usefixtures("known")
def test_a_second_round_with_another_robot(refused):
    line = refused("plan", "--after", "known", "--half-gauge", "0.2")
    assert line == "half_gauge = 0.2: must be that of known, 0.168 m, or left out"
