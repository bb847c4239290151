import numpy as np
import pytest
from evo.core import metrics, sync
from evo.core.trajectory import PoseTrajectory3D
from evo.core.units import Unit
from evo.tools import file_interface

from trackslip.identification.prediction import Statistics
from trackslip.kinematics import advance, wrap_angle
from trackslip.odometry import evaluation as errors
from trackslip.odometry.evaluation import Trajectory, stretches, write_tum


def trajectory(seed=0, count=400, noise=0.01):
    """A robot that winds about at 10 Hz, standing for a while, and an estimate whose errors
    grow.
    """
    rng = np.random.default_rng(seed)
    time = 100.0 + 0.1 * np.arange(count)
    speed = np.where((time > 115) & (time < 118), 0.0, 0.25)
    twist = np.column_stack([speed, 0.4 * np.sin(0.3 * time)])
    measured = np.zeros((count, 3))
    estimated = np.tile([2.0, -1.0, 2.5], (count, 1))
    for k in range(1, count):
        measured[k] = advance(measured[k - 1], twist[k], 0.1)
        estimated[k] = advance(estimated[k - 1], twist[k] * [1.02, 0.95], 0.1)
    measured = measured + noise * rng.standard_normal(measured.shape)
    steps = np.diff(measured[:, :2], axis=0)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])
    starts = np.ones(count, bool)
    return Trajectory("drive", time, way, measured, estimated, measured[:, 2], starts)


def of_evo(time, pose):
    none = np.zeros(len(pose))
    position = np.column_stack([pose[:, :2], none])
    half = pose[:, 2] / 2
    quaternion = np.column_stack([np.cos(half), none, none, np.sin(half)])
    return PoseTrajectory3D(position, quaternion, time)


def evo_statistics(metric, reference, estimate):
    metric.process_data((reference, estimate))
    found = metric.get_all_statistics()
    return [found[name] for name in ("rmse", "mean", "median", "max")]


def statistics(values):
    found = Statistics.of(values)
    return [found.rms, found.mean, found.median, found.largest]


@pytest.mark.parametrize("length", [0.3, 1.0, 2.0, 5.0])
def test_relative_errors_after_metres_are_those_of_evo(length):
    drive = trajectory()
    reference = of_evo(drive.time, drive.measured)
    estimate = of_evo(drive.time, drive.estimated)
    way, *missed = errors.errors_after_metres(drive, length)
    pairs = {
        "delta": length,
        "delta_unit": Unit.meters,
        "all_pairs": True,
        "pairs_from_reference": True,
    }
    for relation, found in zip(("translation_part", "rotation_angle_rad"), missed, strict=True):
        metric = metrics.RPE(metrics.PoseRelation[relation], **pairs)
        expected = evo_statistics(metric, reference, estimate)
        np.testing.assert_allclose(statistics(found), expected, atol=1e-6)
        assert len(way) == len(metric.error) > 100


def test_errors_after_seconds_are_those_of_evo_after_frames():
    drive = trajectory()
    reference = of_evo(drive.time, drive.measured)
    estimate = of_evo(drive.time, drive.estimated)
    for seconds in (1.0, 2.0, 5.0, 10.0):
        way, position, _ = errors.errors_after_seconds(drive, seconds)
        frames = metrics.RPE(
            metrics.PoseRelation.translation_part, round(10 * seconds), Unit.frames, all_pairs=True
        )
        expected = evo_statistics(frames, reference, estimate)
        np.testing.assert_allclose(statistics(position), expected, atol=1e-6)
        assert len(way) == len(frames.error)
    drive.time[:] /= 0.75  # at 7.5 Hz, two poses are half an interval from a second
    way, *_ = errors.errors_after_seconds(drive, 1.0)
    assert len(way) == len(drive.time) - 7


@pytest.mark.parametrize(("start", "origin"), [(0.0, (0.0, 0.0)), (1.7e9, (4.5e5, 5.4e6))])
def test_evo_reads_stamps_of_clocks_and_positions_on_the_earth(tmp_path, start, origin):
    drive = trajectory(count=30)
    time = drive.time + start
    pose = drive.measured + np.array([*origin, 0.0])
    write_tum(tmp_path / "a.tum", time, pose)
    read = file_interface.read_tum_trajectory_file(tmp_path / "a.tum")
    np.testing.assert_allclose(read.timestamps, time, rtol=0, atol=1e-6 if start else 1e-9)
    np.testing.assert_allclose(read.positions_xyz[:, :2], pose[:, :2], rtol=0, atol=1e-8)
    headings = np.array([np.arctan2(pose[1, 0], pose[0, 0]) for pose in read.poses_se3])
    np.testing.assert_allclose(wrap_angle(headings - pose[:, 2]), 0, atol=1e-8)
    matched, _ = sync.associate_trajectories(read, of_evo(time, pose))
    assert matched.num_poses == 30


def test_alignment_finds_a_known_motion():
    drive = trajectory(noise=0.0)
    measured = drive.measured
    elsewhere = errors.moved(measured, 1.3, np.array([0.5, 0.5]), np.array([-3.0, 7.0]))
    best = errors.best_fit(elsewhere, measured)
    from_17 = errors.from_pose(elsewhere, measured, 17)
    for aligned in (best, from_17):
        np.testing.assert_allclose(aligned[:, :2], measured[:, :2], atol=1e-12)
        turn = wrap_angle(aligned[:, 2] - measured[:, 2])
        np.testing.assert_allclose(turn, 0, atol=1e-12)


def test_stretches_cross_a_gap_but_do_not_end_in_it():
    time = np.concatenate([np.arange(0, 5, 0.1), np.arange(12, 20, 0.1)])
    start, end = stretches(time, 2.0, 0.2)
    assert (np.abs(time[end] - time[start] - 2.0) <= 0.2).all()
    ends_in_gap = (time[start] > 3.2) & (time[start] < 5)
    assert not ends_in_gap.any()
    start, end = stretches(time, 8.0, 0.2)
    crosses_gap = (time[start] < 5) & (time[end] >= 12)
    assert crosses_gap.any()
    uneven = np.cumsum(np.random.default_rng(0).uniform(0.01, 0.3, 300))
    start, end = stretches(uneven, 1.0, 0.1)
    assert len(start) > 200
    assert (np.abs(uneven[end] - uneven[start] - 1.0) <= 0.1).all()
    for count in (0, 1, 2):
        start, _ = stretches(uneven[:count], 50.0, 1.0)
        assert not len(start)
