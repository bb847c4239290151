"""The error of localisation against the viewing angle."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest

from experiments.localization_figures import error_against_viewing_angle, sightings
from sim.scanner import LaserScanner
from trackslip.localization.bound import pose_bound
from trackslip.runlog import RunLog, Truth
from trackslip.scan import Plate

MOUNT = np.array([1.0, -2.0, 0.7])
METADATA = {"plate": asdict(Plate()), "scanner": asdict(LaserScanner()), "lrf": {"mount": MOUNT.tolist()}}


def spun_before_the_scanner(rows=2000, metadata=METADATA, factor=1.0):
    """A robot that turns 3 m in front of the LRF, with errors as large as the bound times a factor."""
    phi = np.linspace(0, 2 * np.pi, rows)
    local = np.column_stack([np.full(rows, 3.0), np.zeros(rows), phi])
    covariance = pose_bound(local, Plate(), LaserScanner().bearings, LaserScanner().noise)
    root = np.linalg.cholesky(np.nan_to_num(covariance) + 1e-12 * np.eye(3))
    error = factor * np.einsum("nij,nj->ni", root, np.random.default_rng(0).standard_normal((rows, 3)))
    true, seen = (_to_world(pose) for pose in (local, local + error))
    nothing = np.zeros((rows, 2))
    truth = Truth(true, np.zeros((rows, 3)), nothing, nothing)
    valid = np.arange(rows) % 10 > 0
    return RunLog("spin", 0.05 * np.arange(rows), nothing + 1.0, seen, valid=valid, truth=truth, metadata=metadata)


def _to_world(pose):
    cos, sin = np.cos(MOUNT[2]), np.sin(MOUNT[2])
    turned = pose[:, :2] @ np.array([[cos, sin], [-sin, cos]])
    return np.column_stack([turned + MOUNT[:2], pose[:, 2] + MOUNT[2]])


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_errors_are_those_of_the_poses_and_stand_beside_the_bound(factor):
    seen = sightings([spun_before_the_scanner(factor=factor)])
    assert seen is not None
    assert 0 <= seen.angle.min() < seen.angle.max() <= np.pi / 2
    clear = seen.measured & (seen.angle > np.radians(5))
    ratio = np.sqrt(np.mean((seen.error / seen.bound)[clear] ** 2, axis=0))
    np.testing.assert_allclose(ratio, factor, rtol=0.08)
    assert seen.facts()["looked"] == "2000"
    assert seen.facts()["missed"] == "200"
    figure = error_against_viewing_angle(seen)
    assert [axis.get_ylabel() for axis in figure.axes] == ["error of position, rms [mm]", "error of heading, rms [°]"]
    assert all(axis.get_xlabel() == "angle between plate and line of sight [°]" for axis in figure.axes)
    assert [len(axis.lines) for axis in figure.axes] == [4, 2]


@pytest.mark.parametrize("key", ["plate", "scanner", "lrf"])
def test_nothing_is_drawn_unless_plate_scanner_and_mount_are_known(key):
    metadata = {name: value for name, value in METADATA.items() if name != key}
    assert sightings([spun_before_the_scanner(20, metadata)]) is None
    assert sightings([]) is None
