"""The Cramér-Rao bound of a law's parameters from a drive: the smallest errors that any unbiased estimate can have."""

from collections.abc import Callable

import numpy as np
import scipy

from trackslip.kinematics import Array

_BAND = 5  # off-diagonals of the normal equations: neighbouring poses of three numbers each
_DIFFERENCE = 1e-5  # for derivatives, in the parameters' units


def drive_bound(steps: Callable[[Array], Array], truth: Array, step_deviation: Array, pose_deviation: Array) -> Array:
    """Standard deviations (p,) of unbiased estimates of p parameters, the trajectory being unknown as well.

    Errors of the M poses and of the steps between them are normal and independent: noise of x, y, heading, and slip
    forwards, sideways, of the heading. Poses and parameters are linearised about the truth.

    Args:
        steps: the relative poses (M - 1, 3) of neighbouring poses, each in the frame of the one before, by the law with
            parameters (p,).
        truth: true parameters (p,).
        step_deviation: standard deviations of the steps (M - 1, 3) [m, m, rad].
        pose_deviation: those of each pose, x and y alike (3,) [m, m, rad]; infinite for a heading that isn't measured.
    """
    step = steps(truth)
    change = _DIFFERENCE * np.eye(len(truth))
    slope = np.stack([steps(truth + d) - steps(truth - d) for d in change], axis=-1) / (
        2 * _DIFFERENCE
    )  # (M - 1, 3, p)
    slope /= step_deviation[..., None]
    before, after = _sensitivity(step)
    before, after = before / step_deviation[..., None], after / step_deviation[..., None]
    count = len(step) + 1
    same = np.zeros((count, 3, 3))  # diagonal blocks of the normal equations of the poses
    same += np.diag(1 / pose_deviation**2)
    same[:-1] += np.einsum("kij,kil->kjl", before, before)
    same[1:] += np.einsum("kij,kil->kjl", after, after)
    cross = np.einsum("kij,kil->kjl", before, after)  # (M - 1, 3, 3) above the diagonal
    border = np.zeros((count, 3, len(truth)))
    border[:-1] -= np.einsum("kij,kip->kjp", before, slope)
    border[1:] -= np.einsum("kij,kip->kjp", after, slope)
    flat = border.reshape(3 * count, -1)
    solved = scipy.linalg.solveh_banded(_banded(same, cross), flat)
    information = np.einsum("kip,kiq->pq", slope, slope) - flat.T @ solved
    return np.sqrt(np.diag(np.linalg.inv(information)))


def _sensitivity(step: Array) -> tuple[Array, Array]:
    """How steps (K, 3) change with the pose before and the pose after, each moved in its own frame: (K, 3, 3) each."""
    x, y, turn = step.T
    before, after = np.zeros((2, len(step), 3, 3))
    before[:] = -np.eye(3)
    before[:, 0, 2], before[:, 1, 2] = y, -x
    after[:, 0, 0] = after[:, 1, 1] = np.cos(turn)
    after[:, 1, 0] = np.sin(turn)
    after[:, 0, 1] = -after[:, 1, 0]
    after[:, 2, 2] = 1.0
    return before, after


def _banded(same: Array, cross: Array) -> Array:
    """The upper band (6, 3 M) of a symmetric matrix of blocks (M, 3, 3) on and (M - 1, 3, 3) above the diagonal."""
    count = len(same)
    band = np.zeros((_BAND + 1, 3 * count))
    columns = 3 * np.arange(count)
    for i in range(3):
        for j in range(3):
            if i <= j:
                band[_BAND + i - j, columns + j] = same[:, i, j]
            band[_BAND + i - j - 3, columns[1:] + j] = cross[:, i, j]
    return band
