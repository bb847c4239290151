"""Covariances of poses, as a plate in scans has them: good across, poor along."""

from dataclasses import replace

import numpy as np
import pytest
from drives import EXACT, GEOMETRY, drive_log

from sim.wander.motion import WHITE
from trackslip.identification.drive_law import fit_drives
from trackslip.identification.drives import whitening

TRUE = {"offset": 0.045, "radius_error": 0.0066}


def random_covariances(rng, count):
    root = rng.normal(size=(count, 3, 3)) * 0.15 + np.eye(3)
    return root @ root.swapaxes(1, 2) * 1e-4


def test_residuals_become_white():
    rng = np.random.default_rng(0)
    covariance = random_covariances(rng, 500)
    found = whitening(np.zeros((500, 3)), covariance)
    white = np.einsum("kij,kjl,kml->kim", found, covariance, found)
    off = white - np.einsum("kii->ki", white)[:, :, None] * np.eye(3)
    np.testing.assert_allclose(off, 0, atol=1e-12)
    usual = np.median(np.einsum("kii->ki", white), axis=0)
    np.testing.assert_allclose(np.einsum("kii->ki", white), np.broadcast_to(usual, (500, 3)), rtol=1e-9)
    assert usual[0] == pytest.approx(usual[1])
    assert not found[:, 2, :2].any()


def test_what_is_not_stated_counts_as_usual():
    rng = np.random.default_rng(1)
    pose, covariance = np.zeros((20, 3)), random_covariances(rng, 20)
    covariance[3] = np.nan
    pose[5, 2] = np.nan
    covariance[7] = 0.0
    found = whitening(pose, covariance)
    for k in (3, 7):
        np.testing.assert_array_equal(found[k], np.eye(3))
    assert not found[5, :2, 2].any()
    assert whitening(pose, None) is None
    covariance[:12] = np.nan
    assert whitening(pose, covariance) is None


def plate_log(seed, stated=True):
    """A drive whose positions are known to 0.5 mm in one direction and 5 mm in the other, as its heading goes."""
    rng = np.random.default_rng(seed)
    log = drive_log(seed, 60.0, EXACT)
    valid = log.is_valid
    cos, sin = np.cos(log.pose[valid, 2]), np.sin(log.pose[valid, 2])
    error = rng.normal(size=(valid.sum(), 3)) * [5e-3, 5e-4, 5e-3]
    pose = log.pose.copy()
    pose[valid] += np.column_stack(
        [cos * error[:, 0] - sin * error[:, 1], sin * error[:, 0] + cos * error[:, 1], error[:, 2]]
    )
    covariance = np.full((len(valid), 3, 3), np.nan)
    turn = np.zeros((valid.sum(), 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = cos
    turn[:, 0, 1], turn[:, 1, 0], turn[:, 2, 2] = -sin, sin, 1
    covariance[valid] = turn @ np.diag([25e-6, 25e-8, 25e-6]) @ turn.swapaxes(1, 2) * 4  # a scale that is wrong
    return replace(log, pose=pose, covariance=covariance if stated else None)


def test_laws_are_as_accurate_as_they_say():
    deviations = []
    for seed in range(5):
        found = fit_drives("icr_radius", [plate_log(seed)], GEOMETRY)
        assert found.free[:2] == ("offset", "radius_error")
        deviations.append([(found.values[name] - true) / found.stderr[name] for name, true in TRUE.items()])
        assert found.noise["slip_forward"] < 2.5 * WHITE.along
    spread = np.sqrt(np.mean(np.square(deviations), axis=0))
    assert ((spread > 0.4) & (spread < 1.8)).all()


def test_without_them_such_poses_tell_less():
    """Errors along the way look like slip, where the estimator takes them to be the same in all directions."""
    stated, without = (fit_drives("icr_radius", [plate_log(0, known)], GEOMETRY) for known in (True, False))
    assert without.noise["slip_forward"] > 2 * stated.noise["slip_forward"]


def test_equal_covariances_change_nothing():
    log = drive_log(0, 40.0)
    known = replace(log, covariance=np.broadcast_to(np.diag([4e-4, 4e-4, 3e-4]), (len(log.time), 3, 3)))
    assert whitening(log.pose, known.covariance) is None
    plain, whitened = (fit_drives("icr_radius", [one], GEOMETRY) for one in (log, known))
    for name, value in plain.values.items():
        assert whitened.values[name] == pytest.approx(value, rel=1e-9)
        assert whitened.stderr[name] == pytest.approx(plain.stderr[name], rel=1e-9)


def test_covariances_that_tell_nothing_are_not_used():
    log = plate_log(0)
    order = np.flatnonzero(log.is_valid)
    shuffled = log.covariance.copy()
    shuffled[order] = log.covariance[np.random.default_rng(3).permutation(order)]
    plain, stated, wrong = (
        fit_drives("icr_radius", [replace(log, covariance=one)], GEOMETRY) for one in (None, log.covariance, shuffled)
    )
    assert stated.deviance < plain.deviance - 100
    assert wrong.fit.nodes.whitening is None
    assert wrong.values == plain.values
