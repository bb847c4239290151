"""The Cramér-Rao bound of a drive, against closed forms, a dense computation, and the errors of a best estimate."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.studies.drive_bound import drive_bound
from sim.wander.motion import arc_steps, joined
from trackslip.kinematics import RobotGeometry
from trackslip.slip.icr import ConstantIcr

GEOMETRY = RobotGeometry(0.168, 0.06)
TRUTH = np.array([0.045, 0.0066])
PERIOD = 0.1
OMEGA = np.random.default_rng(0).uniform(-5, 5, (60, 2))
WAY = np.abs(OMEGA).mean(axis=1) * 0.06 * PERIOD
SLIP = np.sqrt(WAY)[:, None] * [0.002, 0.002, 0.005]


def steps(values: np.ndarray) -> np.ndarray:
    twist = ConstantIcr(values[0], 0.168, values[1]).twist(OMEGA, GEOMETRY)
    return arc_steps(np.insert(twist, 1, 0.0, axis=-1), PERIOD)


def test_with_exact_poses_every_step_counts_by_itself():
    bound = drive_bound(steps, TRUTH, SLIP, np.full(3, 1e-9))
    h = 1e-6
    slope = np.stack([(steps(TRUTH + d) - steps(TRUTH - d)) / (2 * h) for d in h * np.eye(2)], axis=-1)
    information = np.einsum("kip,kiq->pq", slope / SLIP[..., None], slope / SLIP[..., None])
    np.testing.assert_allclose(bound, np.sqrt(np.diag(np.linalg.inv(information))), rtol=1e-4)


@pytest.mark.parametrize("noise", [(0.02, 0.02, 0.017), (0.002, 0.002, 0.0044), (0.05, 0.05, np.inf)])
def test_a_dense_computation_agrees(noise):
    """All poses as functions of the parameters, the slip of all steps and the first pose, by finite differences."""
    h, count = 1e-6, len(OMEGA)
    seen = np.isfinite(noise)

    def poses(values: np.ndarray) -> np.ndarray:
        path = joined(values[2:5], steps(values[:2]) + values[5:].reshape(count, 3))
        return (path[:, seen] / np.array(noise)[seen]).ravel()

    at = np.concatenate([TRUTH, np.zeros(3 + 3 * count)])
    slope = np.stack([(poses(at + d) - poses(at - d)) / (2 * h) for d in h * np.eye(len(at))], axis=-1)
    information = slope.T @ slope
    information[5:, 5:] += np.diag(1 / SLIP.ravel() ** 2)
    expected = np.sqrt(np.diag(np.linalg.inv(information))[:2])
    np.testing.assert_allclose(drive_bound(steps, TRUTH, SLIP, np.array(noise)), expected, rtol=1e-3)
