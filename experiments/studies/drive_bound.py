"""The Cramér-Rao bound of a law's parameters from a drive: the smallest errors that any unbiased estimate can have."""

from collections.abc import Callable

import numpy as np
import scipy

from sim.wander.motion import LawMotion, SlipVariation, steps_between
from sim.wander.pose_source import PoseSource
from trackslip.kinematics import Array

_DIFFERENCE = 1e-5  # for derivatives, in the parameters' units
_LEAST_WAY = 1e-6  # of a step, for a robot at rest [m]


def pose_source_bound(
    silent: Callable[[Array], LawMotion],
    truth: Array,
    omega: Array,
    rate: float,
    stamps: Array,
    slip: SlipVariation,
    source: PoseSource,
) -> Array:
    """The bounds (p,) for poses that a source stamps by the encoders' clock.

    Args:
        silent: the motion by the law with parameters (p,), without slip that varies.
        truth: true parameters (p,).
        omega: readings of the encoders (T, 2) [rad/s].
        rate: of the encoders [Hz].
        stamps: of the poses (M,) [s].
        slip: that varies, which must be white.
        source: of the poses, with its noise.
    """

    def steps(values: Array) -> Array:
        return steps_between(silent(values).drive(omega, rate, np.random.default_rng(0))[0].at(stamps))

    speed = silent(truth).geometry.sprocket_radius * np.abs(omega[1:]).mean(axis=1)
    way = np.concatenate([[0.0], np.cumsum(speed / rate)])
    between = np.diff(np.interp(stamps, np.arange(len(way)) / rate, way))
    deviation = np.sqrt(np.maximum(between, _LEAST_WAY))[:, None] * [slip.along, slip.across, slip.turning]
    noise = np.array([source.position_noise, source.position_noise, source.heading_noise])
    return drive_bound(steps, truth, deviation, noise)


def drive_bound(steps: Callable[[Array], Array], truth: Array, step_deviation: Array, pose_deviation: Array) -> Array:
    """Standard deviations (p,) of unbiased estimates of p parameters, the trajectory being unknown as well.

    Errors of the M poses and of the steps between them are normal and independent: noise of x, y, heading, and slip
    forwards, sideways, of the heading. Poses and parameters are linearised about the truth.

    Args:
        steps: the relative poses (M - 1, 3) of neighbouring poses, each in the frame of the one before, by the law with
            parameters (p,).
        truth: true parameters (p,).
        step_deviation: standard deviations of the steps (M - 1, 3) [m, m, rad].
        pose_deviation: standard deviations of each pose (3,) [m, m, rad], the same for x and y; infinite for a heading
            that isn't measured.
    """
    step = steps(truth)
    count = len(step)
    change = _DIFFERENCE * np.eye(len(truth))
    slope = np.stack([steps(truth + d) - steps(truth - d) for d in change], axis=-1) / (2 * _DIFFERENCE)
    scale = 1 / step_deviation[..., None]
    of_values = (slope * scale).reshape(3 * count, -1)
    blocks = np.stack(_derivatives(step), axis=1) * scale[:, None]  # (M - 1, 2, 3, 3)
    neighbours = np.add.outer(np.arange(count), [0, 1]).ravel()
    rows = 2 * np.arange(count + 1)
    of_poses = scipy.sparse.bsr_array((blocks.reshape(-1, 3, 3), neighbours, rows)).tocsc()
    measured = scipy.sparse.diags_array(np.tile(1 / pose_deviation**2, count + 1))
    border = of_poses.T @ of_values
    known = scipy.sparse.linalg.splu((of_poses.T @ of_poses + measured).tocsc()).solve(border)
    return np.sqrt(np.diag(np.linalg.inv(of_values.T @ of_values - border.T @ known)))


def _derivatives(step: Array) -> tuple[Array, Array]:
    """Of steps (K, 3) by the pose before and the pose after, each moved in its own frame: (K, 3, 3) each."""
    x, y, turn = step.T
    before, after = np.zeros((2, len(step), 3, 3))
    before[:] = -np.eye(3)
    before[:, 0, 2], before[:, 1, 2] = y, -x
    after[:, 0, 0] = after[:, 1, 1] = np.cos(turn)
    after[:, 1, 0] = np.sin(turn)
    after[:, 0, 1] = -after[:, 1, 0]
    after[:, 2, 2] = 1.0
    return before, after
