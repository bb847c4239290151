"""ROS bags in commands: read by bag and identify, written by --bag, and from teleoperation to ros2_control and back."""

from __future__ import annotations

import sys

import numpy as np
import pyarrow.parquet
import pytest
from bags import in_order, joints_of, odometry, pose_with_covariance, poses_of, write_bag
from diff_drive import DiffDrive, parameters_in
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from wandered import wandered

import trackslip
import trackslip as package
from experiments.cli import main, parse
from experiments.common import results
from experiments.identify.config import source_of
from trackslip import load
from trackslip.logs.logfile import read_runs
from trackslip.logs.schema import COLUMNS

LOG = wandered(duration=20.0)
ROBOT = "--half-gauge 0.168 --sprocket-radius 0.06"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    write_bag(folder / "run", "foxglove", in_order(joints_of(LOG), poses_of(LOG)))
    motors = joints_of(LOG, names=("x1", "x2"), topic="/motors")
    both = in_order(motors, joints_of(LOG), poses_of(LOG, pose_with_covariance), poses_of(LOG), poses_of(LOG, odometry))
    write_bag(folder / "doubtful", "mcap", both)
    return folder


def test_topics_are_listed_with_what_they_are_for_and_doubts(folder, capsys):
    main(["bag", str(folder / "run.mcap")])
    printed = capsys.readouterr().out
    rows = {line.split()[0]: line for line in printed.splitlines() if line.strip().startswith("/")}
    assert rows["/joint_states"].split()[1:5] == ["sensor_msgs/JointState", "400", "20.0", "0.05"]
    assert "* encoders" in rows["/joint_states"]
    assert "* poses: measured poses" in rows["/slam/pose"]
    main(["bag", str(folder / "doubtful")])
    assert "poses may be /amcl_pose, /slam/pose: choose with --poses TOPIC" in capsys.readouterr().out
    main(["bag", str(folder / "doubtful"), "--poses", "/slam/pose"])
    assert "choose with" not in capsys.readouterr().out


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_the_log_is_written_with_units_and_not_replaced_unasked(folder, tmp_path, refused, capsys, suffix):
    file = tmp_path / f"log{suffix}"
    command = ["bag", str(folder / "run.mcap"), "--export", str(file)]
    main(command)
    assert f"{file}: 1 run, 400 rows" in capsys.readouterr().out
    (log,) = package.load(file)
    (read,) = package.load(folder / "run.mcap")
    for name in ("time", "omega", "pose"):
        np.testing.assert_array_equal(getattr(log, name), getattr(read, name))
    if suffix == ".parquet":
        for field in pyarrow.parquet.read_schema(file):
            assert field.metadata[b"unit"].decode() == COLUMNS[field.name].unit
    assert f"log{suffix}: exists already; --overwrite replaces it" in refused(*command)
    main([*command, "--overwrite"])
    assert [path.name for path in tmp_path.iterdir()] == [file.name]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("bag {0}/none.mcap", "none.mcap: no such file or folder"),
        ("bag {0}/run.mcap --export log.txt", "export = 'log.txt': must be a file that ends in .parquet or .csv"),
        ("bag {0}/run.mcap --left a", "right = None: must be given where left is"),
        ("bag {0}/run.mcap --left a,,b --right c", "left = 'a,,b': must be names of joints, separated by"),
        ("bag {0}/doubtful --export x.csv", "poses may be /amcl_pose, /slam/pose: choose with --poses TOPIC"),
        (f"identify {{0}}/doubtful {ROBOT}", "poses may be /amcl_pose, /slam/pose: choose with --poses TOPIC"),
        (f"identify {{0}}/run.mcap {ROBOT} --poses /scan", "it has no topic '/scan'; its topics are /joint_states"),
        (f"identify {{0}}/run.mcap {ROBOT} --where a=1", "holds bags, not runs of a sweep"),
    ],
)
def test_what_is_refused(folder, refused, line, message):
    assert message in refused(*line.format(folder).split())


def test_identify_takes_what_it_is_told(folder):
    options = ("--encoders", "/motors", "--left", "x2", "--right", "x1", "--reversed", "both", "--poses", "/amcl_pose")
    source = source_of(parse(["identify", str(folder / "doubtful"), *ROBOT.split(), *options]))
    (log,) = source.logs
    np.testing.assert_allclose(log.omega[1:], -LOG.omega[1:, ::-1], atol=1e-9)
    assert source.taken == ("encoders: /motors, left x2, right x1; poses: /amcl_pose (as asked for)",)


def test_export_and_view_read_bags_too(folder, tmp_path, capsys):
    main(["export", str(folder / "run.mcap"), "--csv", "--out", str(tmp_path / "run.csv")])
    assert package.load(tmp_path / "run.csv")[0].run == "run"
    assert "1 run, 400 rows" in capsys.readouterr().out


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


def test_a_grids_bags_have_its_scans_and_change_no_number(trackslip, tmp_path, monkeypatch):
    arguments = (*GRID, "--obstacles", "posts", "--out", str(tmp_path / "out"))

    def stopped(*arguments, **named):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(results, "write_bags", stopped)
        with pytest.raises(SystemExit):
            main([*arguments, "--bag"])
    result = trackslip(*arguments, "--bag")
    assert result.summary["timing"]["taken"] == 1
    assert result.summary["bags"] == {"radius=1.5 speed=0.2": "bags/radius=1.5_speed=0.2"}
    (log,) = read_runs(result.folder / "runs.parquet")
    bag = read(result.folder / result.summary["bags"][log.run])
    assert set(bag) == WHEELS | SCANNED | {"/pose"}
    stamps, scans = bag["/scan"]
    assert stamps == nanoseconds(log.time)
    ranges = np.array([scan.ranges for scan in scans])
    np.testing.assert_array_equal(np.where(np.isinf(ranges), np.nan, ranges), log.scans.full)
    assert (np.isfinite(ranges).sum(axis=1) > log.scans.cluster.count).all()  # posts, too
    without = trackslip(*arguments)
    assert not (without.folder / "bags").exists()
    (plain,) = read_runs(without.folder / "runs.parquet")
    np.testing.assert_array_equal(log.pose, plain.pose)
    assert plain.scans.full is None


def test_a_closed_loops_bag_is_stamped_in_the_middle_of_its_scans(trackslip):
    circle = ("--reference", "circle", "--circle-duration", "2")
    result = trackslip("track", *circle, "--bag", "--scanner.scan-duration", "0.02")
    (log,) = read_runs(result.folder / "runs.parquet")
    bag = read(result.folder / result.summary["bags"][log.run])
    assert set(bag) == WHEELS | SCANNED | {"/pose"}
    assert bag["/scan"][0] == nanoseconds(log.time - 0.01)


@pytest.mark.parametrize(
    ("motion", "source", "topic"),
    [("mujoco", "slam", "/pose"), ("law", "scanner", "/pose"), ("law", "gnss", "/fix")],
)
def test_a_drives_bag_has_poses_of_its_source(trackslip, motion, source, topic):
    result = trackslip("wander", "--motion", motion, "--source", source, "--duration", "4", "--bag")
    (log,) = read_runs(result.folder / "runs.parquet")
    bag = read(result.folder / "bags" / "random_1")
    assert set(bag) == WHEELS | {topic} | (SCANNED if source == "scanner" else set())
    assert bag["/joint_states"][0] == [20_000_000 * k for k in range(201)]  # only its own readings
    stamps, poses = bag[topic]
    assert stamps == nanoseconds(log.time[log.valid])
    if topic == "/pose":
        noise = {"slam": 0.02, "scanner": 0.002}[source]
        assert all(pose.pose.covariance[0] == noise**2 for pose in poses)
    if source == "scanner":
        assert set(np.diff(bag["/scan"][0])) <= {49_999_999, 50_000_000, 50_000_001}
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


def test_without_rosbags_nothing_is_driven(refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    assert refused("wander", "--bag") == "bags need the package rosbags: pip install 'trackslip[ros]'"


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


LENGTHS = (1.0, 2.0, 5.0)  # driven, after which headings are compared [m]
GAIN = 5.0  # least factor by which heading errors get smaller


def heading_errors(controller, log):
    """RMS heading error of the controller's odometry per metre [rad/m], over stretches of LENGTHS."""
    heading, true = controller.odometry(log.time, log.omega)[:, 2], log.truth.pose
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(true[:, :2], axis=0).T))])
    errors = []
    for length in LENGTHS:
        start = np.flatnonzero(driven + length <= driven[-1])
        end = np.searchsorted(driven, driven[start] + length)
        missed = (heading[end] - heading[start]) - (true[end, 2] - true[start, 2])
        errors.append(np.sqrt(np.mean(missed**2)) / length)
    return np.array(errors)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(9))
def test_odometry_with_deployed_parameters_turns_as_the_robot_does_on_another_drive(
    seed, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    main(["wander", "--drives", "2", "--duration", "60", "--seed", str(seed), "--bag", "--out", "driven"])
    main(["identify", "driven/bags/random_1", *ROBOT.split(), "--out", "mine"])
    main(["deploy", "mine", "--to", "ros2_control", "--out", "controller.yaml"])
    parameters = parameters_in((tmp_path / "controller.yaml").read_text())
    ones = parameters | {key: 1.0 for key in parameters if key.endswith("multiplier")}
    (other,) = (log for log in trackslip.load("driven") if log.run == "random 2")
    before, after = (heading_errors(DiffDrive.of(one), other) for one in (ones, parameters))
    with capsys.disabled():
        print(f"\nseed {seed}: heading errors smaller by {np.round(before / after, 1)} after {LENGTHS} m")
    assert (before > GAIN * after).all()
