"""A robot that turns on the spot in front of the scanner."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from sim.scanner.scanner import LaserScanner
from trackslip import se2
from trackslip.localization.bound import pose_bound
from trackslip.localization.scan import Plate
from trackslip.logs.runlog import RunLog, Truth

MOUNT = np.array([1.0, -2.0, 0.7])
METADATA = {"plate": asdict(Plate()), "scanner": asdict(LaserScanner()), "lrf": {"mount": MOUNT.tolist()}}


def spun_before_the_scanner(rows=2000, metadata=METADATA, factor=1.0):
    """A robot that turns 3 m in front of the LRF, with errors as large as the bound times a factor."""
    phi = np.linspace(0, 2 * np.pi, rows)
    local = np.column_stack([np.full(rows, 3.0), np.zeros(rows), phi])
    covariance = pose_bound(local, Plate(), LaserScanner().bearings, LaserScanner().noise)
    root = np.linalg.cholesky(np.nan_to_num(covariance) + 1e-12 * np.eye(3))
    error = factor * np.einsum("nij,nj->ni", root, np.random.default_rng(0).standard_normal((rows, 3)))
    true, seen = (se2.compose(MOUNT, pose) for pose in (local, local + error))
    nothing = np.zeros((rows, 2))
    truth = Truth(true, np.zeros((rows, 3)), nothing, nothing)
    valid = np.arange(rows) % 10 > 0
    return RunLog("spin", 0.05 * np.arange(rows), nothing + 1.0, seen, valid=valid, truth=truth, metadata=metadata)
