"""The drawbar force of a towed load, written to the engine."""

import numpy as np
from mujoco import batch

from sim.bodies import Rows
from sim.drive.pull import Pull
from sim.robot.robot import Robot
from trackslip.kinematics import Array


class Drawbar:
    """The pull on N robots, written to the engine."""

    def __init__(self, pull: Pull, robot: Robot, of: batch.Batch) -> None:
        """The same `pull` for all robots of the batch `of`."""
        self._pull = pull
        self._chassis = robot.model.body("chassis").id
        self._wrench = of.bind("xfrc_applied")[:, self._chassis]  # (N, 6), live
        self._batch, self._centre = of, robot.model.body_ipos  # (bodies, 3) centres of mass

    def apply(self, rows: Rows, heading: Array, acts: np.ndarray) -> None:
        """Apply the pull to those of the robots `rows` (R,), at headings (R,) [rad], on which it `acts` (R,)."""
        force = np.where(acts, self._pull.force, 0.0)
        moved = self._batch.expanded("body_ipos")
        centre = self._centre[self._chassis] if moved is None else moved[rows, self._chassis]
        cos, sin, zero = np.cos(heading), np.sin(heading), np.zeros_like(force)
        pitch, yaw = force * (centre[..., 2] - self._pull.height), -force * centre[..., 1]
        self._wrench[rows] = np.stack([-force * cos, -force * sin, zero, -pitch * sin, pitch * cos, yaw], axis=-1)

    def acts(self, time: Array) -> np.ndarray:
        """Mask (R,) of the robots on which the force acts, at times (R,) since the start of their runs [s]."""
        return time >= self._pull.since - 1e-9
