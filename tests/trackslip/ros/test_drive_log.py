"""Logs of drives from bags: rows, clocks, what is taken, and what looks wrong."""

import json
import subprocess
import sys

import numpy as np
import pytest
from bags import (
    START,
    header,
    in_order,
    joint_states,
    joints_of,
    odometry,
    pose_stamped,
    pose_with_covariance,
    poses_of,
    sprocket_angles,
    stamp,
    transform,
    write_bag,
)
from wandered import GEOMETRY, wandered

import trackslip
from trackslip.errors import LogError, LogWarning
from trackslip.logs.logfile import RUNS, write_parquet
from trackslip.ros.choice import BagChoice
from trackslip.ros.drive_log import read_bags

LOG = wandered(duration=30.0)


def write(tmp_path, *messages, name="run", kind="mcap"):
    return write_bag(tmp_path / name, kind, in_order(*messages))


def dead_reckoned(log, gauge=GEOMETRY.half_gauge, radius=GEOMETRY.sprocket_radius, heading=0.4):
    """Poses at a log's times by the wheels alone, on arcs."""
    turned = log.omega[1:] * np.diff(log.time)[:, None] * radius
    turns = (turned[:, 1] - turned[:, 0]) / (2 * gauge)
    phi = heading + np.concatenate([[0.0], np.cumsum(turns)])
    chord = turned.mean(axis=1) * np.sinc(turns / 2 / np.pi)
    middle = phi[:-1] + turns / 2
    way = np.cumsum(chord[:, None] * np.column_stack([np.cos(middle), np.sin(middle)]), axis=0)
    return np.column_stack([np.concatenate([np.zeros((1, 2)), way]), phi])


def odometry_of(log, **others):
    return [
        odometry(stamp(time), where, **others)
        for time, where in zip(log.time, dead_reckoned(log).tolist(), strict=True)
    ]


def test_rows_are_those_of_readings_and_poses(tmp_path):
    """Poses 13 ms after every other reading: rows of their own, with the speeds of the reading after them."""
    late = [
        pose_stamped(at + 13_000_000 - 1_000_000, where)
        for (_, _, at, _), where in zip(poses_of(LOG), LOG.pose[LOG.is_valid].tolist(), strict=True)
    ]
    (log,) = trackslip.load(write(tmp_path, joints_of(LOG), late))
    assert log.run == "run"
    seen = np.flatnonzero(log.is_valid)
    np.testing.assert_allclose(log.time[seen], LOG.time[LOG.is_valid] + 0.013, atol=1e-9)
    np.testing.assert_allclose(log.pose[seen], LOG.pose[LOG.is_valid], atol=1e-9)
    readings = np.flatnonzero(~log.is_valid)
    np.testing.assert_allclose(log.time[readings], LOG.time, atol=1e-9)
    np.testing.assert_allclose(log.omega[readings[1:]], LOG.omega[1:], atol=1e-9)
    np.testing.assert_array_equal(log.omega[seen], log.omega[seen + 1])
    assert np.isnan(log.pose[readings]).all()


def test_times_are_exact_to_the_nanosecond(tmp_path):
    (log,) = trackslip.load(write(tmp_path, joints_of(LOG), poses_of(LOG)))
    np.testing.assert_array_equal(np.round(log.time * 1e9).astype(int), np.round(LOG.time * 1e9).astype(int))
    assert log.metadata["bag"]["start"] == START / 1e9
    assert log.metadata["bag"]["poses"] == "/slam/pose"


def test_covariances_are_in_the_rows_of_their_poses(tmp_path):
    (log,) = trackslip.load(write(tmp_path, joints_of(LOG), poses_of(LOG, pose_with_covariance)))
    np.testing.assert_array_equal(log.covariance[log.is_valid], np.tile(1e-4 * np.eye(3), (300, 1, 1)))
    assert np.isnan(log.covariance[~log.is_valid]).all()


def test_geometry_is_asked_for_before_the_bag_is_read(tmp_path):
    (tmp_path / "run.mcap").write_bytes(b"nonsense")
    with pytest.raises(
        trackslip.InvalidValueError, match=r"half_gauge = None: must be given .*run\.mcap does not state it"
    ):
        trackslip.identify(tmp_path / "run.mcap")


def test_a_bag_without_poses_is_left_out_of_a_folder(tmp_path):
    write(tmp_path, joints_of(LOG), poses_of(LOG), name="good", kind="foxglove")
    write(tmp_path, joints_of(LOG, start=START + 10**12), name="poor", kind="foxglove")
    with pytest.warns(LogWarning, match=r"run 'poor' left out: .*poor\.mcap: no poses: no topic of"):
        (log,) = trackslip.load(tmp_path)
    assert log.run == "good"


def test_a_folder_of_results_stays_one(tmp_path):
    write_parquet([LOG], tmp_path / RUNS)
    write(tmp_path, joints_of(LOG), poses_of(LOG), name="beside")
    (log,) = trackslip.load(tmp_path)
    assert log.run == "drive"
    with pytest.raises(trackslip.InvalidValueError, match=r"poses = '/a': must be left out: .* is no bag"):
        trackslip.load(tmp_path, BagChoice(poses="/a"))


def test_odometry_from_the_wheels_is_no_pose(tmp_path):
    path = write(tmp_path, joints_of(LOG), odometry_of(LOG))
    with pytest.raises(
        LogError, match=r"/odom: its poses repeat the dead reckoning of the wheels: they tell nothing of slip"
    ):
        read_bags(path)
    assert read_bags(path, BagChoice(poses="/odom")).notes == (
        "/odom: its poses repeat the dead reckoning of the wheels: they tell nothing of slip",
    )


def test_nor_are_transforms_that_pass_it_on(tmp_path):
    chain = [
        *(
            transform(stamp(t), "odom", "base_link", p)
            for t, p in zip(LOG.time, dead_reckoned(LOG).tolist(), strict=True)
        ),
        transform(START, "map", "odom", (0.0, 0.0, 0.0), topic="/tf_static"),
    ]
    with pytest.raises(LogError, match=r"tf:map:base_link: its poses repeat the dead reckoning of the wheels"):
        read_bags(write(tmp_path, joints_of(LOG), chain))


def test_ways_from_the_wheels_with_turns_of_a_gyroscope_are_told(tmp_path):
    """As a filter makes them of wheels and an inertial unit."""
    gyro = dead_reckoned(LOG, gauge=GEOMETRY.half_gauge + 0.04)
    rng = np.random.default_rng(0)
    gyro[:, 2] += 0.02 * np.cumsum(rng.standard_normal(len(gyro))) * np.sqrt(0.05)
    turned = LOG.omega[1:].mean(axis=1) * np.diff(LOG.time) * GEOMETRY.sprocket_radius
    middle = (gyro[1:, 2] + gyro[:-1, 2]) / 2
    gyro[1:, :2] = np.cumsum(turned[:, None] * np.column_stack([np.cos(middle), np.sin(middle)]), axis=0)
    fused = [
        odometry(stamp(t), where, topic="/odometry/filtered") for t, where in zip(LOG.time, gyro.tolist(), strict=True)
    ]
    read = read_bags(write(tmp_path, joints_of(LOG), fused))
    assert read.notes == ("/odometry/filtered: its ways repeat those of the wheels: they tell nothing of ε",)


def test_measured_poses_are_not_taken_for_wheel_odometry(tmp_path):
    assert read_bags(write(tmp_path, joints_of(LOG), poses_of(LOG, odometry))).notes == ()


@pytest.mark.parametrize(("side", "sign"), [("left", [-1, 1]), ("right", [1, -1])])
def test_an_encoder_that_counts_backwards_is_turned_round(tmp_path, side, sign):
    angle = sprocket_angles(LOG) * sign
    joints = [joint_states(stamp(t), ["left", "right"], p) for t, p in zip(LOG.time, angle.tolist(), strict=True)]
    path = write(tmp_path, joints, poses_of(LOG))
    read = read_bags(path)
    np.testing.assert_allclose(read.runs[0].omega[1:], LOG.omega[1:], atol=1e-9)
    assert read.notes == (
        f"topic /joint_states: the {side} encoder counts backwards: turned round, as with --reversed {side}",
    )
    asked = read_bags(path, BagChoice(reversed=side))
    np.testing.assert_allclose(asked.runs[0].omega[1:], LOG.omega[1:], atol=1e-9)
    assert not asked.notes


def test_swapped_sides_are_told(tmp_path):
    path = write(tmp_path, joints_of(LOG, names=("a", "b")), poses_of(LOG))
    read = read_bags(path, BagChoice(left=("b",), right=("a",)))
    assert read.notes == ("topic /joint_states: left and right are swapped, or the poses are mirrored",)
    assert not read_bags(path, BagChoice(left=("a",), right=("b",))).notes


def test_a_heading_that_points_backwards_is_told(tmp_path):
    back = [
        pose_stamped(stamp(t), (x, y, phi + np.pi))
        for t, (x, y, phi) in zip(LOG.time[LOG.is_valid], LOG.pose[LOG.is_valid].tolist(), strict=True)
    ]
    (note,) = read_bags(write(tmp_path, joints_of(LOG), back)).notes
    assert "both encoders count backwards (--reversed both), or the poses' heading points backwards" in note


@pytest.mark.parametrize("start", [0, 5_000_000_000])
def test_simulated_and_wall_time_together(tmp_path, start):
    path = write(tmp_path, joints_of(LOG), poses_of(LOG, start=start, late=START))
    stamped = (
        r"topic /joint_states is stamped from 1700000000\.000 to 1700000029\.950 s and topic /slam/pose from \d\.\d+ to"
    )
    with pytest.raises(LogError, match=stamped + r" \d+\.\d+ s: different clocks, simulated and wall time"):
        read_bags(path)


def test_simulated_time_alone_is_a_time_like_any_other(tmp_path):
    (log,) = trackslip.load(write(tmp_path, joints_of(LOG, start=0), poses_of(LOG, start=0)))
    np.testing.assert_allclose(log.time, LOG.time, atol=1e-9)


def test_clocks_that_differ_by_seconds_are_told(tmp_path):
    early = poses_of(LOG, start=START - 3_000_000_000, late=3_000_000_000)
    _, note = read_bags(write(tmp_path, joints_of(LOG), early)).notes
    assert note.startswith(
        "topic /joint_states was recorded 0.001 s after its stamps, /slam/pose 3 s after its own: do"
    )


def test_a_simulation_that_was_reset_makes_two_drives(tmp_path):
    second = [(t, k, at + 40_000_000_000, fields) for t, k, at, fields in in_order(joints_of(LOG), poses_of(LOG))]
    read = read_bags(write(tmp_path, joints_of(LOG), poses_of(LOG), second))
    assert [log.run for log in read.runs] == ["run, part 1", "run, part 2"]
    for log in read.runs:
        np.testing.assert_allclose(log.omega[1:], LOG.omega[1:], atol=1e-9)
    partly = [one for one in second if one[0] == "/joint_states"]
    with pytest.raises(
        LogError, match=r"time goes back 1 time\(s\) in topic /joint_states and 0 time\(s\) in /slam/pose"
    ):
        read_bags(write(tmp_path, joints_of(LOG), poses_of(LOG), partly, name="partly"))


def test_poses_without_encoders_are_told(tmp_path):
    (note,) = read_bags(write(tmp_path, joints_of(LOG)[:300], poses_of(LOG))).notes
    assert note == "/slam/pose: 150 of 300 poses left out: /joint_states doesn't cover them"


def test_without_rosbags_one_line_says_what_to_install(tmp_path, monkeypatch):
    path = write(tmp_path, joints_of(LOG), poses_of(LOG))
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(
        trackslip.TrackslipError, match=r"bags need the package rosbags: pip install 'trackslip\[ros\]'"
    ):
        trackslip.load(path)


_CODE = """
import json, resource, sys, time
from pathlib import Path
from trackslip.ros.bag import open_bag
from trackslip.ros.drive_log import read_bags
path = Path(sys.argv[1])
(log,) = read_bags(path).runs
beams = sum(len(message.content.ranges) for message in open_bag(path).messages("/scan"))
memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
print(json.dumps([len(log.time), beams, time.process_time(), memory]))
"""
_DURATION = 600.0


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "compression"), [("ros1", "lz4"), ("sqlite3", None), ("mcap", "storage")])
def test_ten_minutes_are_read_in_fifteen_seconds_and_a_gigabyte(tmp_path, kind, compression):
    rng = np.random.default_rng(0)
    log = wandered(duration=_DURATION)
    time = np.arange(0.0, _DURATION, 0.02)
    turned = np.column_stack([np.interp(time, log.time, side) for side in np.cumsum(log.omega * 0.05, axis=0).T])
    joints = [joint_states(stamp(t), ["left", "right"], p, p) for t, p in zip(time, turned.tolist(), strict=True)]
    poses = [pose_with_covariance(stamp(t), p) for t, p in zip(log.time, log.pose.tolist(), strict=True)]
    scans = [_scan(stamp(t), rng) for t in log.time]
    path = write_bag(tmp_path / "run", kind, in_order(joints, poses, scans), compression=compression)
    done = subprocess.run([sys.executable, "-c", _CODE, str(path)], capture_output=True, text=True, check=True)
    rows, beams, seconds, memory = json.loads(done.stdout)
    assert rows == len(np.union1d(np.round(time, 9), np.round(log.time, 9)))
    assert beams == 721 * len(log.time)
    assert seconds < 15.0
    assert memory < 1.0


def _scan(at, rng):
    ranges, intensities = rng.uniform(1.0, 5.0, 721), rng.uniform(0.0, 255.0, 721)
    fields = {"header": header(at, "laser"), "range_max": 30.0, "ranges": ranges, "intensities": intensities}
    return "/scan", "sensor_msgs/msg/LaserScan", at + 1_000_000, fields
