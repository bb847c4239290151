"""`--bag` on the commands that drive: which topics there are, and that they are what the run measured."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from experiments.cli import main
from experiments.storage import results
from trackslip import load
from trackslip.logs.logfile import read_runs

WHEELS = {"/joint_states", "/odom", "/tf", "/cmd_vel", "/ground_truth"}
SCANNED = {"/scan", "/tf_static"}
GRID = ("grid", "--radii", "1.5", "--speeds", "0.2", "--duration", "4", "--executor", "inline")


def read(path):
    """Stamps [s] since the first second of the bag, and messages, by topic."""
    store, found = get_typestore(Stores.ROS2_JAZZY), {}
    with Reader(path) as reader:
        for connection, stamp, data in reader.messages():
            rows = found.setdefault(connection.topic, ([], []))
            rows[0].append(stamp - 1_767_225_600 * 10**9)
            rows[1].append(store.deserialize_cdr(data, connection.msgtype))
    return found


def nanoseconds(time):
    return [round(t * 1e9) for t in time.tolist()]


def test_a_grids_bags_have_its_scans(trackslip):
    result = trackslip(*GRID[:4], "0.1", *GRID[4:], "--bag", "--obstacles", "posts")
    bags = result.summary["bags"]
    logs = read_runs(result.folder / "runs.parquet")
    assert [log.run for log in logs] == list(bags)
    assert bags["radius=1.5 speed=0.1"] == "bags/radius=1.5_speed=0.1"
    assert f"{result.folder / 'bags'}: 2 ROS 2 bags" in result.printed
    for log in logs:
        bag = read(result.folder / bags[log.run])
        assert set(bag) == WHEELS | SCANNED | {"/pose"}
        stamps, scans = bag["/scan"]
        assert stamps == nanoseconds(log.time)
        ranges = np.array([scan.ranges for scan in scans])
        np.testing.assert_array_equal(np.where(np.isinf(ranges), np.nan, ranges), log.scans.full)
        assert (np.isfinite(ranges).sum(axis=1) > log.scans.cluster.count).all()  # posts, too
        np.testing.assert_array_equal([joints.velocity for joints in bag["/joint_states"][1]], log.omega)
        covariance = np.array([pose.pose.covariance.reshape(6, 6) for pose in bag["/pose"][1]])
        np.testing.assert_array_equal(covariance[:, 0, 0], log.covariance[log.valid, 0, 0])
        assert (covariance[:, 5, 5] > 0).all()


def test_bags_change_no_number_and_resumed_ones_are_the_same(trackslip, tmp_path, monkeypatch):
    out = ("--bag", "--out", str(tmp_path / "a"))

    def stopped(*arguments, **named):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(results, "write_bags", stopped)
        with pytest.raises(SystemExit):
            main([*GRID, *out])
    resumed = trackslip(*GRID, *out)
    assert resumed.summary["timing"]["taken"] == 1
    fresh = trackslip(*GRID, "--bag", "--out", str(tmp_path / "b"))
    (place,) = fresh.summary["bags"].values()
    (one,), (other,) = ((folder / place).glob("*.mcap") for folder in (resumed.folder, fresh.folder))
    assert one.read_bytes() == other.read_bytes()
    without = trackslip(*GRID, "--out", str(tmp_path / "b"))
    assert not (without.folder / "bags").exists()
    (with_all,), (with_plate,) = read_runs(resumed.folder / "runs.parquet"), read_runs(without.folder / "runs.parquet")
    np.testing.assert_array_equal(with_all.pose, with_plate.pose)
    assert with_plate.scans.full is None


def test_track(trackslip):
    circle = ("--reference", "circle", "--circle-duration", "2")
    result = trackslip("track", *circle, "--bag", "--scanner.scan-duration", "0.02")
    (log,) = read_runs(result.folder / "runs.parquet")
    bag = read(result.folder / result.summary["bags"][log.run])
    assert set(bag) == WHEELS | SCANNED | {"/pose"}
    assert bag["/scan"][0] == nanoseconds(log.time - 0.01)
    commanded = [(message.twist.linear.x, message.twist.angular.z) for message in bag["/cmd_vel"][1]]
    np.testing.assert_array_equal(commanded, log.twist_command)


@pytest.mark.parametrize(
    ("motion", "source", "topic", "kind"),
    [
        ("mujoco", "slam", "/pose", "PoseWithCovarianceStamped"),
        ("law", "scanner", "/pose", "PoseWithCovarianceStamped"),
        ("law", "mocap", "/pose", "PoseStamped"),
        ("law", "gnss", "/fix", "NavSatFix"),
        ("law", "odometry", "/visual_odometry", "Odometry"),
    ],
)
def test_wander(trackslip, motion, source, topic, kind):
    result = trackslip("wander", "--motion", motion, "--source", source, "--duration", "4", "--bag")
    (log,) = read_runs(result.folder / "runs.parquet")
    bag = read(result.folder / "bags" / "random_1")
    assert set(bag) == WHEELS | {topic} | (SCANNED if source == "scanner" else set())
    stamps, joints = bag["/joint_states"]
    assert stamps == [20_000_000 * k for k in range(201)]  # only its own readings
    rows = np.isin(nanoseconds(log.time), stamps)
    np.testing.assert_array_equal([reading.velocity for reading in joints], log.omega[rows])
    stamps, poses = bag[topic]
    assert stamps == nanoseconds(log.time[log.valid])
    assert type(poses[0]).__name__.endswith(kind)
    if kind == "PoseWithCovarianceStamped":
        noise = {"slam": 0.02, "scanner": 0.002}[source]
        assert all(pose.pose.covariance[0] == noise**2 for pose in poses)
        np.testing.assert_array_equal([pose.pose.pose.position.x for pose in poses], log.pose[log.valid, 0])
    if kind == "NavSatFix":
        assert all(fix.position_covariance[0] == 0.05**2 for fix in poses)
    if source == "scanner":
        stamps = bag["/scan"][0]
        assert set(np.diff(stamps)) <= {49_999_999, 50_000_000, 50_000_001}
        assert_plate_is_there(bag, log.truth)


def assert_plate_is_there(bag, truth):
    """All returns are on the outline of the plate where the robot is, within noise."""
    start, end = (bag["/tf_static"][1][0].transforms[0].transform.translation, truth.pose[0])
    assert np.hypot(start.x - end[0], start.y - end[1]) == pytest.approx(3.0)
    true = bag["/ground_truth"]
    for stamp, scan in list(zip(*bag["/scan"], strict=True))[::20]:
        pose = true[1][np.searchsorted(true[0], stamp)].pose.pose
        seen = np.isfinite(scan.ranges)
        angle = np.pi / 2 + scan.angle_min + scan.angle_increment * np.flatnonzero(seen)
        x = start.x + scan.ranges[seen] * np.cos(angle) - pose.position.x
        y = start.y + scan.ranges[seen] * np.sin(angle) - pose.position.y
        turned = (x + 1j * y) * np.exp(-2j * np.arctan2(pose.orientation.z, pose.orientation.w))
        outside = np.maximum(np.abs(turned.real) - 0.3, np.abs(turned.imag) - 0.02)
        assert seen.sum() > 20
        assert np.abs(outside).max() < 5 * 0.005 + 0.02 * 0.3 * 2


@pytest.mark.parametrize("command", [GRID, ("track",), ("wander",)])
def test_without_rosbags_nothing_is_driven(refused, monkeypatch, command):
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    assert refused(*command, "--bag") == "bags need the package rosbags: pip install 'trackslip[ros]'"


def test_a_folder_of_other_bags_is_kept(refused, tmp_path):
    mine = tmp_path / "out" / "bags" / "mine" / "mine.mcap"
    mine.parent.mkdir(parents=True)
    mine.touch()
    assert "bags there contains files that aren't part of results" in refused("wander", "--bag", "--out", "out")
    assert mine.exists()


@pytest.mark.parametrize("source", ["slam", "gnss"])
def test_a_drive_and_its_bag_are_read_alike(trackslip, source):
    result = trackslip("wander", "--motion", "law", "--source", source, "--duration", "20", "--bag")
    (log,), (again,) = load(result.folder), load(result.folder / "bags")
    time = again.time - again.time[0] + log.time[0]
    np.testing.assert_allclose(time, log.time, atol=2e-9)
    np.testing.assert_allclose(again.omega[1:], log.omega[1:], atol=1e-4)  # times in whole nanoseconds
    np.testing.assert_array_equal(again.is_valid, log.is_valid)
    place = [one.pose[one.is_valid, :2] for one in (log, again)]
    first = place[0][0] if source == "gnss" else 0.0  # fixes have the first one as origin
    np.testing.assert_allclose(place[1], place[0] - first, atol=1e-6)
