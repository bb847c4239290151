from dataclasses import replace

import numpy as np
import pytest
from bound import pose_bound

from trackslip.errors import LogError
from trackslip.kinematics import advance
from trackslip.localization.plate import PlateLocator
from trackslip.localization.scan import Plate, extract_plate
from trackslip.logs.runlog import RunLog, ScanLog
from trackslip.motion.arc import arc, poses_on_arc
from trackslip.motion.bundle import bundle
from trackslip.motion.steady_twist import even_poses, long_run_covariance, paper

WINDOW = (1.5, 29.0)


def circle_log(twist, rows=600, step=0.05, noise=(0.0, 0.0, 0.0), seed=0, valid=None):
    time = np.arange(rows) * step
    pose = advance([1.0, 2.0, 0.5], np.asarray(twist), time)
    pose = pose + np.random.default_rng(seed).normal(size=pose.shape) * noise
    return RunLog("circle", time, np.ones((rows, 2)), pose, valid=valid)


@pytest.mark.parametrize(("radius", "seconds"), [(0.6, 5.0), (3.0, 15.0)])
def test_gaps_are_bridged_along_the_arc(radius, seconds):
    """A chord would be too short, by 1 - sinc(turn / 2) of the gap."""
    twist = (0.15, 0.15 / radius)
    time = np.arange(600) * 0.05
    valid = (time < 10) | (time > 10 + seconds)
    log = circle_log(twist, valid=valid)
    true = log.pose.copy()
    log.pose[~valid] = np.nan
    _, pose = even_poses(log)
    np.testing.assert_allclose(pose, true, atol=1e-9)


METHODS = {"arc": arc, "paper": paper}


@pytest.mark.parametrize("method", ["arc", "paper"])
@pytest.mark.parametrize("twist", [(0.25, 0.4), (0.05, 0.02), (-0.2, 0.3), (0.2, 0.0), (0.0, 0.5)])
def test_every_method_finds_the_twist_of_an_arc(method, twist):
    found = METHODS[method](circle_log(twist), WINDOW)
    tolerance = {"arc": 2e-6, "paper": 5e-6}[method]  # a chord is shorter
    np.testing.assert_allclose(found.twist, twist, atol=tolerance)


def test_standard_errors_are_those_of_repeats():
    """Of noise without memory, and with one of half a second."""
    twist = (0.1, 0.08)
    log = circle_log(twist)
    for memory in (0.0, 0.9):
        found = []
        for seed in range(30):
            rng = np.random.default_rng(seed)
            noise = rng.normal(size=log.pose.shape) * [0.002, 0.002, 0.004]
            for k in range(1, len(noise)):
                noise[k] = memory * noise[k - 1] + np.sqrt(1 - memory**2) * noise[k]
            noisy = RunLog("noisy", log.time, log.omega, log.pose + noise)
            found.append(arc(noisy, WINDOW))
        error = np.array([steady.twist - twist for steady in found])
        variance = np.array([np.diag(steady.covariance) for steady in found])
        ratio = np.sqrt(np.mean(error**2, axis=0) / variance.mean(axis=0))
        assert np.all(ratio < 1.6), ratio
        error_of_mean = error.std(axis=0) / np.sqrt(len(error))
        assert np.all(np.abs(error.mean(axis=0)) < 4 * error_of_mean)


def test_a_lateral_speed_does_not_bend_the_arc():
    """A centre of rotation ahead of the middle: the robot goes sideways, steadily."""
    time = np.arange(600) * 0.05
    v = 0.2
    u = -0.02
    w = 0.3
    phi = 0.4 + w * time
    x = (v * np.sin(phi) + u * np.cos(phi)) / w
    y = (-v * np.cos(phi) + u * np.sin(phi)) / w
    log = RunLog("sideways", time, np.ones((600, 2)), np.column_stack([x, y, phi]))
    found = arc(log, WINDOW)
    np.testing.assert_allclose(found.twist, [v, w], atol=2e-6)
    assert found.lateral == pytest.approx(u, abs=2e-6)


@pytest.mark.parametrize("method", ["arc", "paper"])
def test_a_window_without_poses_is_refused(method):
    time = np.arange(600) * 0.05
    without_poses = circle_log((0.1, 0.1), valid=(time < 20) | (time > 24.5))
    said = "hardly any valid pose between 20 s and 25 s, where it is steady"
    with pytest.raises(LogError, match=said):
        arc(without_poses, (20.0, 25.0))
    said = r"its steady window between 29\.5 s and 30 s is short: it has 9 poses"
    with pytest.raises(LogError, match=said):
        METHODS[method](circle_log((0.1, 0.1)), (29.5, 30.0))


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 1.0])
def test_long_run_covariance_is_that_of_newey_and_west(share):
    """The sum of the autocovariances, weighted by 1 - lag / (lags + 1)."""
    series = np.cumsum(np.random.default_rng(0).standard_normal((60, 3)), axis=0)
    series -= series.mean(axis=0)
    lags = int(share * 60)
    expected = series.T @ series
    for lag in range(1, min(lags, 59) + 1):
        product = series[lag:].T @ series[:-lag]
        weight = 1 - lag / (lags + 1)
        expected += weight * (product + product.T)
    found = long_run_covariance(series, share)
    np.testing.assert_allclose(found, expected / 60, rtol=1e-12, atol=1e-12 * 60)


TWIST = np.array([0.2, 0.25])
SCANNED = (1.0, 29.0)
PLATE = Plate()


@pytest.fixture(scope="module")
def logs(scan_rectangle):
    """The same run scanned twenty times with other noise, on circles shifted a little; and its true
    poses.
    """
    time = np.arange(0, 30, 0.2)
    found = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        y = -0.5 + rng.uniform(-0.05, 0.05)
        heading = 0.3 + rng.uniform(-0.1, 0.1)
        pose = advance([2.0, y, heading], TWIST, time)
        scan = scan_rectangle(pose, rng)
        estimate = PlateLocator().locate(scan)
        half_turns = np.round((estimate.pose[:, 2] - pose[:, 2]) / np.pi)
        located = estimate.pose - np.pi * half_turns[:, None] * [0, 0, 1]
        cluster = extract_plate(scan, PLATE, scan.from_world(pose))
        scanner = replace(scan, ranges=np.empty((0, len(scan.bearings))))
        scans = ScanLog(scanner, PLATE, cluster)
        log = RunLog("circle", time, np.ones((150, 2)), located, valid=estimate.valid, scans=scans)
        found.append((log, pose))
    return found


def test_bundle_is_at_the_bound_and_its_errors_are_its_scatter(logs):
    found = [bundle(log, SCANNED) for log, _ in logs]
    error = np.array([steady.twist for steady in found]) - TWIST
    rms = np.sqrt(np.mean(error**2, axis=0))
    spread = 3 / np.sqrt(2 * len(logs))  # three standard errors of an rms, relative to it

    # the bound of a pose and a twist with lateral speed, from the bounds of the single scans that
    # have one
    log, pose = logs[0]
    rows = (log.time > SCANNED[0]) & (log.time < SCANNED[1])
    covariance = pose_bound(pose[rows], PLATE, log.scans.scan.bearings, log.scans.scan.noise)
    is_bounded = np.isfinite(covariance).all(axis=(1, 2))
    v, w = TWIST
    since_middle = log.time[rows] - log.time[75]
    _, jacobian = poses_on_arc(np.array([*pose[75], v, 0.0, w]), since_middle)
    jacobian = jacobian[is_bounded]
    weight = np.linalg.inv(covariance[is_bounded])
    information = np.einsum("tki,tkl,tlj->ij", jacobian, weight, jacobian)
    of_v_and_w = [3, 5]
    bound = np.sqrt(np.diag(np.linalg.inv(information)))[of_v_and_w]
    assert np.all(rms < 1.1 * bound * (1 + spread))

    variances = [np.diag(steady.covariance) for steady in found]
    stated = np.sqrt(np.mean(variances, axis=0))
    assert np.all(np.abs(rms / stated - 1) < spread)
    error_of_mean = rms / np.sqrt(len(logs))
    assert np.all(np.abs(error.mean(axis=0)) < 3.5 * error_of_mean)
    by_arc = [arc(log, SCANNED).twist for log, _ in logs]
    assert np.all(error.std(axis=0) < np.std(by_arc, axis=0))


def test_scans_of_something_else_are_left_out(logs):
    log, _ = logs[0]
    cluster = log.scans.cluster
    nearer = cluster.range.copy()
    is_spoilt = (cluster.row >= 50) & (cluster.row < 65)
    nearer[is_spoilt] -= 0.4
    spoilt = replace(log, scans=replace(log.scans, cluster=replace(cluster, range=nearer)))
    clean = bundle(log, SCANNED)
    change = bundle(spoilt, SCANNED).twist - clean.twist
    assert np.all(np.abs(change) < np.sqrt(np.diag(clean.covariance)))


def with_returns(log, count):
    """The log with only the first returns of the plate in each scan, by their `count` (T,)."""
    cluster = log.scans.cluster
    first = np.cumsum(cluster.count) - cluster.count
    number = np.arange(len(cluster.range)) - first[cluster.row]
    kept = number < count[cluster.row]
    cut = replace(cluster, bearing=cluster.bearing[kept], range=cluster.range[kept], count=count)
    return replace(log, scans=replace(log.scans, cluster=cut))


def test_scans_of_half_the_plate_are_left_out(logs):
    """Their ranges fit, but the edge of what they show isn't one of the plate."""
    log, _ = logs[0]
    rows = np.arange(len(log.time))
    some = (rows >= 50) & (rows < 65)
    count = log.scans.cluster.count
    halved = bundle(with_returns(log, np.where(some, count // 2, count)), SCANNED)
    without = bundle(with_returns(log, np.where(some, 0, count)), SCANNED)
    np.testing.assert_array_equal(halved.twist, without.twist)
    np.testing.assert_array_equal(halved.covariance, without.covariance)


def test_scans_that_lack_a_return_count(logs):
    log, _ = logs[0]
    rows = np.arange(len(log.time))
    count = log.scans.cluster.count
    some = (rows >= 50) & (rows < 65)
    lacking = bundle(with_returns(log, np.where(some, count - 1, count)), SCANNED)
    without = bundle(with_returns(log, np.where(some, 0, count)), SCANNED)
    assert (np.diag(lacking.covariance) < np.diag(without.covariance)).all()


def test_a_scan_needs_three_returns(logs):
    log, _ = logs[0]
    rows = np.arange(len(log.time))
    count = log.scans.cluster.count
    some = (rows >= 50) & (rows < 65)
    two = bundle(with_returns(log, np.where(some, 2, count)), SCANNED)
    without = bundle(with_returns(log, np.where(some, 0, count)), SCANNED)
    np.testing.assert_array_equal(two.twist, without.twist)


def test_ranges_that_fit_no_pose_are_refused(logs):
    log, _ = logs[0]
    cluster = log.scans.cluster
    nearer = replace(cluster, range=cluster.range - 0.4)
    with pytest.raises(LogError, match="run 'circle': its ranges don't fit its poses"):
        bundle(replace(log, scans=replace(log.scans, cluster=nearer)), SCANNED)


def test_logs_without_ranges_are_refused(logs):
    log, _ = logs[0]
    log = replace(log, scans=None)
    with pytest.raises(LogError, match="has no ranges, which bundle needs"):
        bundle(log, SCANNED)
