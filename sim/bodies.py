"""Bodies: N robots in a MuJoCo batch, where they are and what pushes them."""

from __future__ import annotations

import numpy as np
from mujoco import batch

from sim.robot.robot import Robot
from trackslip.kinematics import Array

Rows = np.ndarray | slice
"""Which of N robots."""


class Bodies:
    """The bodies of N robots, each in a world of its own."""

    def __init__(self, robot: Robot, size: int, threads: int) -> None:
        """`size` robots of one model, on `threads` worker threads (0: one per processor)."""
        self.robot = robot
        self.size = size
        self.batch = batch.Batch(robot.model, size, nthread=threads)
        self._sensors = self.batch.bind("sensordata")[:, :6]  # (N, 6), live: force on the left and on the right track
        self._quaternion = tuple(self.batch.qpos[:, 3:7].T)  # four live views (N,)
        # (N, 2), live: the chassis' x axis on the ground
        self._chassis = robot.model.body("chassis").id
        self._forward = self.batch.bind("xmat")[:, self._chassis, 0:4:3]
        self.plate = self.batch.bind("geom_xpos")[:, robot.model.geom("plate").id]
        """Middles (N, 3) of the robots' plates one physics step ago [m], live."""
        self._fresh = self.batch.state[0].copy()  # of a robot that has done nothing yet
        self._heading: Array = np.zeros(size)  # unwrapped

    def pose(self) -> Array:
        """True poses (N, 3) of the chassis [m, m, rad]; phi unwrapped."""
        qpos = self.batch.qpos
        return np.column_stack([qpos[:, 0], qpos[:, 1], self._heading])

    def twist(self) -> Array:
        """True twists (N, 3): forward speed, lateral speed to the left [m/s], yaw rate [rad/s]."""
        velocity = self.batch.qvel
        cos, sin = np.cos(self._heading), np.sin(self._heading)
        x, y = velocity[:, 0], velocity[:, 1]
        return np.column_stack([cos * x + sin * y, -sin * x + cos * y, velocity[:, 5]])

    def traction(self) -> Array:
        """Forces of the ground on the (left, right) tracks, along the robot, (N, 2) [N], in the last physics step."""
        return along_robot(self._sensors, self._forward)

    def load(self) -> Array:
        """Forces of the ground that hold up the (left, right) tracks, (N, 2) [N]."""
        return self._sensors[:, 2::3].copy()

    def attitude(self) -> Array:
        """Sink (positive downwards) [m], roll and pitch [rad] of the chassis, (N, 3)."""
        w, x, y, z = self._quaternion
        roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
        return np.column_stack([-self.batch.qpos[:, 2], roll, pitch])

    def upright(self) -> Array:
        """Cosines (N,) of the angles by which the chassis lean."""
        _, x, y, _ = self._quaternion
        return 1 - 2 * (x * x + y * y)

    def lean(self) -> Array:
        """How far the plates stand to the left of the chassis, at the height at which they are scanned (N,) [m]."""
        w, x, y, z = self._quaternion
        up = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])  # of the chassis
        along = (self.robot.lrf_height - self.batch.qpos[:, 2]) / up[2]
        return along * (np.cos(self._heading) * up[1] - np.sin(self._heading) * up[0])

    def _place_at(self, rows: np.ndarray, start: Array, height: float = 0.0) -> None:
        """Put the robots `rows` (R,) at poses (R, 3), upright, with nothing left of what they did before."""
        self.batch.state[rows] = self._fresh
        qpos = self.batch.qpos
        qpos[rows, :3] = np.column_stack([start[:, :2], np.full(len(rows), height)])
        qpos[rows, 3:7] = _yaw_quaternion(start[:, 2])

    def _snapshot(self, rows: Rows) -> tuple[Array, ...]:
        return self.batch.state[rows].copy(), self._heading[rows].copy()

    def _restore(self, rows: np.ndarray, snapshot: tuple[Array, ...]) -> None:
        self.batch.state[rows], self._heading[rows] = snapshot

    def _wrapped_heading(self) -> Array:
        w, x, y, z = self._quaternion
        return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

    def _follow_heading(self) -> None:
        """Unwrap the heading, often enough: a robot may have turned by a radian since the last time."""
        wrapped = self._wrapped_heading()  # plus whole turns: the same bits however often it is followed
        self._heading = wrapped + 2 * np.pi * np.round((self._heading - wrapped) / (2 * np.pi))


def along_robot(forces: Array, forward: Array) -> Array:
    """Parts (..., 2) along the directions `forward` (..., 2) of forces (..., 6) on the left and on the right track."""
    x, y = forces[..., 0::3], forces[..., 1::3]
    return x * forward[..., :1] + y * forward[..., 1:]


def _yaw_quaternion(heading: Array) -> Array:
    zero = np.zeros_like(heading)
    return np.column_stack([np.cos(heading / 2), zero, zero, np.sin(heading / 2)])
