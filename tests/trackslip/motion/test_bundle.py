from dataclasses import replace

import numpy as np
import pytest
from bound import pose_bound

from trackslip.errors import LogError
from trackslip.identification.samples import best_method
from trackslip.kinematics import advance
from trackslip.localization.plate import PlateLocator
from trackslip.localization.scan import Plate, extract_plate
from trackslip.logs.logfile import read_runs, write_parquet
from trackslip.logs.runlog import RunLog, ScanLog
from trackslip.motion.arc import arc, poses_on_arc
from trackslip.motion.bundle import bundle

TWIST = np.array([0.2, 0.25])
WINDOW = (1.0, 29.0)
PLATE = Plate()


@pytest.fixture(scope="module")
def logs(scan_rectangle):
    """The same run scanned twenty times with other noise, on circles shifted a little; and its true poses."""
    time = np.arange(0, 30, 0.2)
    found = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        pose = advance([2.0, -0.5 + rng.uniform(-0.05, 0.05), 0.3 + rng.uniform(-0.1, 0.1)], TWIST, time)
        scan = scan_rectangle(pose, rng)
        estimate = PlateLocator().locate(scan)
        heading = estimate.pose[:, 2] - np.pi * np.round((estimate.pose[:, 2] - pose[:, 2]) / np.pi)
        cluster = extract_plate(scan, PLATE, scan.from_world(pose))
        scans = ScanLog(replace(scan, ranges=np.empty((0, len(scan.bearings)))), PLATE, cluster)
        located = np.column_stack([estimate.pose[:, :2], heading])
        log = RunLog("circle", time, np.ones((150, 2)), located, valid=estimate.valid, scans=scans)
        found.append((log, pose))
    return found


def test_bundle_is_at_the_bound_and_its_errors_are_its_scatter(logs):
    found = [bundle(log, WINDOW) for log, _ in logs]
    error = np.array([steady.twist for steady in found]) - TWIST
    rms = np.sqrt(np.mean(error**2, axis=0))
    # the bound of a pose and a twist with lateral speed, from the bounds of the single scans that have one
    log, pose = logs[0]
    rows = (log.time > WINDOW[0]) & (log.time < WINDOW[1])
    covariance = pose_bound(pose[rows], PLATE, log.scans.scan.bearings, log.scans.scan.noise)
    held = np.isfinite(covariance).all(axis=(1, 2))
    _, jacobian = poses_on_arc(np.array([*pose[75], TWIST[0], 0.0, TWIST[1]]), log.time[rows] - log.time[75])
    information = np.einsum("tki,tkl,tlj->ij", jacobian[held], np.linalg.inv(covariance[held]), jacobian[held])
    bound = np.sqrt(np.diag(np.linalg.inv(information)))[[3, 5]]
    assert np.all(rms < 1.1 * bound * (1 + 3 / np.sqrt(2 * len(logs))))
    stated = np.sqrt(np.mean([np.diag(steady.covariance) for steady in found], axis=0))
    assert np.all(np.abs(rms / stated - 1) < 3 / np.sqrt(2 * len(logs)))
    assert np.all(np.abs(error.mean(axis=0)) < 3.5 * rms / np.sqrt(len(logs)))
    assert np.all(error.std(axis=0) < np.std([arc(log, WINDOW).twist for log, _ in logs], axis=0))


def test_scans_of_something_else_are_left_out(logs):
    log, _ = logs[0]
    cluster = log.scans.cluster
    nearer = cluster.range.copy()
    nearer[(cluster.row >= 50) & (cluster.row < 65)] -= 0.4
    spoilt = replace(log, scans=replace(log.scans, cluster=replace(cluster, range=nearer)))
    change = bundle(spoilt, WINDOW).twist - bundle(log, WINDOW).twist
    assert np.all(np.abs(change) < np.sqrt(np.diag(bundle(log, WINDOW).covariance)))


def test_logs_without_ranges_are_refused_and_take_the_arc(logs):
    log = replace(logs[0][0], scans=None)
    with pytest.raises(LogError, match="has no ranges, which bundle needs"):
        bundle(log, WINDOW)
    assert best_method(log) == "arc"
    assert best_method(logs[0][0]) == "bundle"


def test_ranges_survive_their_file_and_a_cut(logs, tmp_path):
    log = logs[0][0]
    hidden = log.scans.cluster.hidden.copy()
    hidden[3, 1] = np.inf
    log = replace(log, scans=replace(log.scans, cluster=replace(log.scans.cluster, hidden=hidden)))
    write_parquet([log, replace(log, run="without", scans=None)], tmp_path / "runs.parquet")
    back, without = read_runs(tmp_path / "runs.parquet")
    assert without.scans is None
    assert back.scans.plate == log.scans.plate
    np.testing.assert_allclose(back.scans.scan.bearings, log.scans.scan.bearings)
    for name, values in vars(log.scans.cluster).items():
        np.testing.assert_allclose(getattr(back.scans.cluster, name), values, rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(bundle(back, WINDOW).twist, bundle(log, WINDOW).twist, rtol=1e-6)
    inner = (6.0, 24.0)
    np.testing.assert_allclose(bundle(log.between(25, 125), inner).twist, bundle(log, inner).twist, rtol=1e-9)
