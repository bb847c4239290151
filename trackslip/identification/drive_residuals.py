"""Residuals of poses and of steps between them, with their derivatives.

Unknown are the state of every node, the sensor's position and the robot's heading (x, y, phi), and the parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from trackslip.identification.drive_model import DriveModel, Steps
from trackslip.identification.drives import PreparedDrive, Timeline
from trackslip.kinematics import Array, wrap_angle

_MIN_DISTANCE = 1e-3  # of a step, so that a robot at rest isn't known to stay exactly [m]


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the kinds of noise.

    Poses are less certain while the robot moves: their stamps jitter, and scanners distort what they see on the way.
    """

    values: Array
    """(7,): position [m] and heading [rad] of poses; slip forwards, sideways [m/sqrt(m)] and in turn [rad/sqrt(m)];
    growth of the first two with the sensor's speed and the yaw rate [s], added in quadrature.

    With a gyro (8,): that of its turns [rad/sqrt(s)].
    """

    NAMES = (
        "position",
        "heading",
        "slip_forward",
        "slip_sideways",
        "slip_turn",
        "position_by_speed",
        "heading_by_yaw_rate",
        "gyro",
    )

    def of_poses(self, rate: Array) -> tuple[Array, Array]:
        """Variances (K, 2) of positions and headings at rest, and those that `rate` (K, 2) adds, of Residuals."""
        return np.broadcast_to(self.values[:2] ** 2, rate.shape), (self.values[5:7] * rate) ** 2

    @property
    def of_steps(self) -> Array:
        """(c,) of the components of steps."""
        return np.append(self.values[2:5], self.values[7:])


@dataclass(frozen=True)
class Nodes:
    """Nodes of all drives in a row, and which of their measurements and steps count."""

    drives: tuple[PreparedDrive, ...]
    timeline: Timeline
    pose: Array  # (K, 3) measured, NaN where not
    weight: Array  # (K, 2) of positions and headings: 1, or 0 for what isn't measured or is left out
    link: Array  # (K - 1,) of steps: 1, or 0 between drives and where poses jump lastingly
    whitening: Array | None = None  # (K, 3, 3) of the residuals of poses; None for those that are white as they are

    @classmethod
    def of(cls, drives: Sequence[PreparedDrive]) -> Nodes:
        """All measurements of the drives."""
        pose = np.concatenate([drive.pose for drive in drives])
        weight = np.isfinite(pose[:, [0, 2]]).astype(float)
        link = np.ones(len(pose) - 1)
        link[np.cumsum([len(drive.time) for drive in drives])[:-1] - 1] = 0.0
        shapes = None
        if any(drive.whitening is not None for drive in drives):
            shapes = np.concatenate([drive.shapes for drive in drives])
        return cls(tuple(drives), Timeline.of(drives), pose, weight, link, shapes)

    @property
    def time(self) -> Array:
        """Times (K,) of the nodes [s]."""
        return np.concatenate([drive.time for drive in self.drives])

    @property
    def first(self) -> np.ndarray:
        """Index of the first node of each drive, and the number of nodes."""
        return np.cumsum([0, *(len(drive.time) for drive in self.drives)])


@dataclass(frozen=True)
class Residuals:
    """Residuals at a trajectory and parameters, with the derivatives of the step residuals.

    Steps have c = 3 components, with a gyro 4, the last being the turn by the gyro. In memory, nodes are the last axis
    of the derivatives.
    """

    pose: Array  # (K, 3) of positions and headings, white, 0 where not measured
    step: Array  # (K - 1, c) in the frame of the first node [m, m, rad, rad]
    by_first: Array  # (K - 1, c, 3) derivatives of step by the state of the first node
    by_second: Array  # (K - 1, c, 3) by that of the second
    by_values: Array  # (K - 1, c, f) by the chosen parameters
    distance: Array  # (K - 1, c) by which variances grow: the way [m], with a gyro the time in the end [s]
    rate: Array  # (K, 2) speed of the sensor [m/s] and yaw rate [rad/s] at the nodes, by the law
    path: Array  # (K, 3) of the turning centre by dead reckoning [m, m, rad]
    free: np.ndarray  # (f,) indices of those parameters

    @property
    def way(self) -> Array:
        """Way of the belts in each step (K - 1,) [m]."""
        return self.distance[:, 0]

    def weighted_as(self, other: Residuals) -> Residuals:
        """The same with the variances of others."""
        return replace(self, distance=other.distance, rate=other.rate)

    def without(self, parameter: int) -> Residuals:
        """The same without the derivatives by a parameter, which is held."""
        kept = self.free != parameter
        return replace(self, by_values=self.by_values[..., kept], free=self.free[kept])


def residuals(model: DriveModel, nodes: Nodes, states: Array, values: Array, free: np.ndarray) -> Residuals:
    """Residuals at states (K, 3) and parameter values (p,), with derivatives by the parameters `free` (f,)."""
    steps = _reckoned(model, nodes, values, free)
    motion, slope, distance = steps.motion, steps.slope, steps.distance[:, None]
    x, y = model.index("sensor_x"), model.index("sensor_y")
    lever = values[x] + 1j * values[y]
    heading, turn = states[:-1, 2], np.diff(states[:, 2])
    ahead, swing = np.exp(1j * heading), np.exp(1j * turn)
    moved = np.diff(states[:, 0] + 1j * states[:, 1]) * ahead.conj()
    swung = swing * lever
    left = moved - (swung - lever)
    step = np.column_stack([left.real - motion[0], left.imag - motion[1], wrap_angle(turn - motion[2])])
    by_second = np.zeros((3, 3, len(step)))
    by_second[0, 0], by_second[0, 1] = ahead.real, ahead.imag
    by_second[1, 0], by_second[1, 1] = -ahead.imag, ahead.real
    by_first = -by_second
    by_second[0, 2], by_second[1, 2] = swung.imag, -swung.real
    by_first[0, 2], by_first[1, 2] = moved.imag - swung.imag, swung.real - moved.real
    by_second[2, 2], by_first[2, 2] = 1.0, -1.0
    by_values = -slope
    by_values[0, free == x], by_values[1, free == x] = 1 - swing.real, -swing.imag
    by_values[0, free == y], by_values[1, free == y] = swing.imag, 1 - swing.real
    if model.gyro:
        turned, by_gyro = model.gyro_turns(values, nodes.timeline, free)
        known = np.isfinite(turned)
        size, turn = 1 + values[model.index("gyro_scale")], wrap_angle(turn)
        step = np.column_stack([step, np.where(known, size * turn - turned, 0.0)])
        by_gyro[free == model.index("gyro_scale")] = -turn
        by_first, by_second = (np.append(one, size * one[2:], axis=0) for one in (by_first, by_second))
        by_values = np.append(by_values, -by_gyro[None], axis=0)
        time = np.where(known, np.diff(nodes.timeline.time), np.inf)
        distance = np.column_stack([*[distance] * 3, time])
    pose = pose_residuals(model, nodes, states, values)
    first, second, chosen = (np.moveaxis(one, -1, 0) for one in (by_first, by_second, by_values))
    rate = np.abs(np.column_stack([steps.velocity + 1j * steps.yaw_rate * lever, steps.yaw_rate]))
    return Residuals(pose, step, first, second, chosen, distance, rate, steps.path, free)


def pose_residuals(model: DriveModel, nodes: Nodes, states: Array, values: Array) -> Array:
    """Positions and headings (K, 3) less those measured, white; 0 where not measured or left out."""
    pose = states - np.where(np.isfinite(nodes.pose), nodes.pose, 0.0)
    pose[:, 2] = wrap_angle(pose[:, 2] + values[model.index("sensor_yaw")])
    if nodes.whitening is not None:
        pose = np.einsum("kij,kj->ki", nodes.whitening, pose)
    return np.where(nodes.weight[:, [0, 0, 1]] > 0, pose, 0.0)


def weights(found: Residuals, nodes: Nodes, noise: Noise) -> tuple[Array, Array]:
    """Reciprocal variances (K, 3) of poses and (K - 1, c) of steps."""
    poses = nodes.weight / sum(noise.of_poses(found.rate))
    steps = nodes.link[:, None] / found.distance / noise.of_steps**2
    return poses[:, [0, 0, 1]], steps


def cost(found: Residuals, nodes: Nodes, noise: Noise) -> float:
    """Weighted sum of squares."""
    poses, steps = weights(found, nodes, noise)
    return float(np.sum(poses * found.pose**2) + np.sum(steps * found.step**2))


def _reckoned(model: DriveModel, nodes: Nodes, values: Array, free: np.ndarray) -> Steps:
    """Steps with motion and slope zero between drives."""
    steps, between = model.steps(values, nodes.timeline, free), nodes.timeline.between
    steps.motion[:, between], steps.slope[..., between], steps.distance[between] = 0.0, 0.0, 1.0
    return replace(steps, distance=np.maximum(steps.distance, _MIN_DISTANCE))
