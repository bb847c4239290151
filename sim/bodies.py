"""Bodies: N robots in a MuJoCo batch, with their poses, twists and contact forces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sim import attitude
from sim.batched_world import BatchedWorld
from sim.robot.robot import Robot
from trackslip import se2
from trackslip.kinematics import Array

Rows = np.ndarray | slice
"""Indices of robots, or a slice of them."""
EVERYONE = slice(None)
"""All robots."""

_TURN = 2 * np.pi


class Bodies(BatchedWorld):
    """The bodies of N robots, each in its own world."""

    STATE: ClassVar[tuple[str, ...]] = ("_heading",)

    def __init__(self, robot: Robot, size: int, threads: int) -> None:
        """`size` robots of one model, on `threads` worker threads (0: one per processor)."""
        super().__init__(robot.model, size, threads)
        self.robot = robot
        self._sensors = self.batch.bind("sensordata")[:, :6]  # (N, 6), live: force on the left and on the right track
        self._place = self.batch.qpos  # (N, 7), live: position and quaternion
        self._velocity = self.batch.qvel  # (N, 6), live: in the world, turning in the robot's frame
        self._quaternion = self._place[:, 3:7]  # (N, 4), live
        self._chassis = robot.model.body("chassis").id
        self._forward = self.batch.bind("xmat")[:, self._chassis, 0:4:3]  # (N, 2), live: x axes of the chassis
        self.plate = self.batch.bind("geom_xpos")[:, robot.model.geom("plate").id]
        """Centres (N, 3) of the robots' plates one physics step ago [m], live."""
        self._heading: Array = np.zeros(size)  # unwrapped
        self.now = Moments(self._place, self._velocity, self._heading)
        """The robots' states, live."""

    def pose(self) -> Array:
        """True poses (N, 3) of the chassis [m, m, rad]; phi unwrapped."""
        return self.now.pose()

    def twist(self) -> Array:
        """True twists (N, 3): forward speed, lateral speed to the left [m/s], yaw rate [rad/s]."""
        return self.now.twist()

    def load(self) -> Array:
        """Normal forces of the ground on the (left, right) tracks in the last physics step, (N, 2) [N]."""
        return self._sensors[:, 2::3].copy()

    def attitude(self) -> Array:
        """Sinkage (positive downwards) [m], roll (to the right) and pitch (forwards) [rad] of the chassis, (N, 3)."""
        turned = self._quaternion
        return np.stack([-self._place[:, 2], attitude.roll(turned), -attitude.pitch(turned)], axis=-1)

    def upright(self) -> Array:
        """Cosines (N,) of the angles between the chassis' vertical axes and the plane's normal."""
        return attitude.upright(self._quaternion)

    def _put_back(self, rows: np.ndarray, start: Array) -> None:
        """Undo the micrometre by which the robots `rows` (R,) drifted from poses (R, 3) while settling."""
        qpos = self._place
        qpos[rows, :2] = start[:, :2]
        half_turn = (start[:, 2] - self._wrapped_heading()[rows]) / 2
        cos, sin = np.cos(half_turn), np.sin(half_turn)
        w, x, y, z = qpos[rows, 3:7].T
        qpos[rows, 3:7] = np.column_stack([cos * w - sin * z, cos * x - sin * y, cos * y + sin * x, cos * z + sin * w])
        self._velocity[rows] = 0
        self.batch.time[rows] = 0
        self._unwrap(rows, start[None, :, 2])

    def _snapshot(self, rows: Rows) -> tuple[Array, ...]:
        return self.batch.state[rows].copy(), self._heading[rows].copy()

    def _restore(self, rows: np.ndarray, snapshot: tuple[Array, ...]) -> None:
        self.batch.state[rows], self._heading[rows] = snapshot

    def _placed(self, rows: Rows) -> Array:
        """Positions of the robots `rows` (R,), (4, R): x, y [m], cosine and sine of the heading."""
        w, x, y, z = self._quaternion.T
        place = np.empty((4, self.size))
        place[:2] = self._place[:, :2].T
        place[2] = 1 - 2 * (y * y + z * z)  # but for the lean, whose square is too small to matter
        place[3] = 2 * (w * z + x * y)
        return place[:, rows]

    def _wrapped_heading(self) -> Array:
        return attitude.heading(self._quaternion)

    def _follow_heading(self, rows: Rows, forward: Array) -> None:
        """Unwrap the headings of the robots `rows` (R,), which pointed to `forward` (P, R, 2) after P periods."""
        self._unwrap(rows, np.concatenate([self._heading[None, rows], np.arctan2(forward[..., 1], forward[..., 0])]))

    def _unwrap(self, rows: Rows, before: Array) -> None:
        """Set the headings of the robots `rows` (R,) by those before (H, R), the first of which is unwrapped."""
        wrapped = self._wrapped_heading()[rows]
        headings = np.concatenate([before, wrapped[None]])
        self._heading[rows] = wrapped + _TURN * np.add.reduce(np.rint((headings[:-1] - headings[1:]) / _TURN))


@dataclass(frozen=True)
class Moments:
    """States of robots, (...) each: of N robots now, or of N robots at T moments."""

    place: Array  # (..., 7) position of the chassis [m] and its quaternion
    velocity: Array  # (..., 6) in the world [m/s], turning in the robot's frame [rad/s]
    heading: Array  # (...) unwrapped [rad]

    def pose(self) -> Array:
        """Poses (..., 3) of the chassis [m, m, rad]; phi unwrapped."""
        pose = np.empty((*self.heading.shape, 3))
        pose[..., :2], pose[..., 2] = self.place[..., :2], self.heading
        return pose

    def twist(self) -> Array:
        """Twists (..., 3): forward speed, lateral speed to the left [m/s], yaw rate [rad/s]."""
        twist = np.empty((*self.heading.shape, 3))
        twist[..., :2], twist[..., 2] = se2.rotate(-self.heading, self.velocity[..., :2]), self.velocity[..., 5]
        return twist

    def lean(self, height: float) -> Array:
        """Offset (...) of the plates from the chassis, to the left, at a height above the ground [m]."""
        w, x, y, z = (self.place[..., k] for k in range(3, 7))
        forward, left, up = 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)  # of the chassis
        along = (height - self.place[..., 2]) / up
        return np.asarray(along * (np.cos(self.heading) * left - np.sin(self.heading) * forward))


def along_robot(forces: Array, forward: Array) -> Array:
    """Components (..., 2) along `forward` (..., 2) of the forces (..., 6) on the left and the right track."""
    x, y = forces[..., 0::3], forces[..., 1::3]
    return x * forward[..., :1] + y * forward[..., 1:]
