"""`trackslip plan`: what it writes and prints, that it can be driven and identified from, and what it refuses."""

from __future__ import annotations

import csv
import json
import sys

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from experiments.cli import main
from experiments.studies import plan_trials
from experiments.work import plan as command
from trackslip.identification.drive.estimate import fit_drives
from trackslip.kinematics import RobotGeometry
from trackslip.logs.logfile import read_runs
from trackslip.planning import plan as planning

ROBOT = ("--half-gauge", "0.168", "--sprocket-radius", "0.06")
SHORT = (*ROBOT, "--duration", "30", "--threads", "1")


@pytest.fixture(autouse=True)
def quick(request, monkeypatch):
    """Few drives are tried, and the paper's runs are two."""
    monkeypatch.setattr(planning, "_EVALUATIONS", 30)
    monkeypatch.setattr(planning, "_FEWEST", 30)
    if "processes" not in request.node.name:  # which see nothing of it
        monkeypatch.setattr(planning, "COMMANDED_RADII", (0.5, 1.0))
        monkeypatch.setattr(planning, "SPEEDS", (0.25,))
    monkeypatch.setattr("experiments.driving.plan.OTHER_DRIVES", 1)


def table(folder):
    with (folder / "plan.csv").open(newline="") as stream:
        header, *rows = csv.reader(stream)
    return header, np.array(rows, float)


def test_commands_as_csv_and_as_a_bag(trackslip):
    result = trackslip("plan", *SHORT)
    header, rows = table(result.folder)
    assert header == ["t", "omega_l", "omega_r", "v", "w"]
    t, left, right, v, w = rows.T
    np.testing.assert_allclose(np.diff(t), 0.02, atol=1e-6)
    np.testing.assert_allclose(v, 0.06 * (left + right) / 2, atol=1e-5)
    np.testing.assert_allclose(w, 0.06 * (right - left) / (2 * 0.168), atol=1e-4)
    assert np.abs(rows[:, 1:3]).max() * 0.06 <= 0.3 + 1e-6
    with AnyReader([result.folder / "bags" / "cmd_vel.mcap"]) as reader:
        (connection,) = reader.connections
        assert (connection.topic, connection.msgtype) == ("/cmd_vel", "geometry_msgs/msg/TwistStamped")
        found = [reader.deserialize(raw, connection.msgtype) for _, _, raw in reader.messages()]
    sent = [(one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec, one.twist) for one in found]
    np.testing.assert_allclose(np.array([stamp for stamp, _ in sent]) - sent[0][0], t, atol=1e-5)
    np.testing.assert_allclose([(one.linear.x, one.angular.z) for _, one in sent], rows[:, 3:], atol=1e-4)
    assert (result.folder / "figures" / "plan.svg").exists()
    assert set(result.summary["stderr"]) >= {"offset", "radius_error"}
    assert "the paper's 25 runs" in result.printed


def test_without_rosbags_a_line_says_that_the_bag_is_left_out(trackslip, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    result = trackslip("plan", *SHORT)
    assert "no ROS 2 bag of the commands: that needs the package rosbags" in result.printed
    assert (result.folder / "plan.csv").exists()
    assert not (result.folder / "bags").exists()


def test_no_bag(trackslip):
    result = trackslip("plan", *SHORT, "--no-bag")
    assert "ROS 2 bag" not in result.printed
    assert not (result.folder / "bags").exists()


def test_a_drive_by_the_law_is_identified_from(trackslip):
    result = trackslip("plan", *SHORT, "--drive")
    trials = result.summary["trials"]
    assert trials["failures"] == []
    assert trials["repeats"] == 1
    assert trials["inside"] == trials["drives"] == plan_trials.DRIVES
    for source in ("plan", "paper"):
        for name, error in trials["real"][source].items():
            assert error < 4 * trials["predicted"][source][name]
    assert all(check["holds"] for check in result.summary["checks"])
    (log,) = read_runs(result.folder / "runs.parquet")
    found = fit_drives("icr_radius", [log], RobotGeometry(0.168, 0.06))
    assert abs(found.values["offset"] - 0.045) < 5 * found.stderr["offset"]
    assert np.abs(log.pose[log.valid, :2]).max() < 1.5 + 0.1


@pytest.mark.slow
def test_from_a_hundred_repeats_on_the_errors_are_checked(trackslip, monkeypatch):
    monkeypatch.setattr(plan_trials, "MIN_REPEATS", 2)
    monkeypatch.setattr(plan_trials, "_AS_GOOD", 30.0)
    result = trackslip("plan", *SHORT, "--drive", "--repeats", "2")
    names = [check["name"] for check in result.summary["checks"]]
    for about in (
        "real over predicted error of offset",
        "error of radius_error over that expected of the paper's runs can have",
    ):
        assert any(about in name for name in names)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bits_at_any_number_of_processes(trackslip, tmp_path):
    files = []
    for k, (seed, threads) in enumerate((("1", "1"), ("1", "2"))):
        options = ("--seed", seed, "--threads", threads, "--out", str(tmp_path / str(k)))
        result = trackslip("plan", *ROBOT, "--duration", "15", "--drive", "--repeats", "2", *options)
        files.append([(result.folder / name).read_bytes() for name in ("plan.csv", "runs.parquet")])
        files[-1].append(json.dumps(result.summary["trials"]))
    assert files[0] == files[1]


@pytest.mark.slow
def test_a_drive_in_mujoco_stays_inside_and_predicts_others(trackslip):
    result = trackslip("plan", *SHORT, "--drive", "--motion", "mujoco")
    assert result.summary["trials"]["inside"] == 1
    assert 0 < result.summary["trials"]["ahead"]["plan"][0] < 0.01
    assert result.summary["trials"]["truth"] is None


def test_a_second_round(trackslip, tmp_path):
    known = {
        "format": 1,
        "geometry": {"half_gauge": 0.168, "sprocket_radius": 0.06},
        "slip_laws": {"icr_radius": {"values": {"offset": 0.04, "radius_error": 0.01}}},
    }
    known["slip_laws"]["icr_radius"]["stderr"] = {"offset": 1e-3, "radius_error": 1e-3}
    (tmp_path / "known").mkdir()
    (tmp_path / "known" / "summary.json").write_text(json.dumps(known))
    result = trackslip("plan", "--after", str(tmp_path / "known"), "--duration", "20")
    assert result.summary["values"] == {"offset": 0.04, "radius_error": 0.01}
    assert result.summary["stderr"]["radius_error"] < 1e-3
    assert result.summary["knowledge"]["reach_doubt"] == pytest.approx(4e-3 / 0.208)


def test_a_second_round_with_another_robot(refused, tmp_path):
    known = {"format": 1, "geometry": {"half_gauge": 0.2, "sprocket_radius": 0.06}}
    known["slip_laws"] = {"icr_radius": {"values": {"offset": 0.04, "radius_error": 0.0}, "stderr": {"offset": 1e-3}}}
    (tmp_path / "known").mkdir()
    (tmp_path / "known" / "summary.json").write_text(json.dumps(known))
    line = refused("plan", "--after", "known", "--half-gauge", "0.168")
    assert line == "half_gauge = 0.168: must be that of known, 0.2 m, or left out"


def test_it_leaves_nothing_when_stopped(tmp_path, monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "write_plan", stopped)
    with pytest.raises(SystemExit):
        main(["plan", *SHORT, "--out", str(tmp_path / "a")])
    assert not (tmp_path / "a").exists()
