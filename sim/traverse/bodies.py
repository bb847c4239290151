"""States of robots on courses, as the quantities that reflexes, observations and logs are made of."""

from __future__ import annotations

import numpy as np

from sim.robot.tracked_model import TrackedModel
from trackslip.kinematics import Array


class States:
    """States of N robots at the end of a control period; of a run that broke down the last finite one."""

    def __init__(self, tracked: TrackedModel, qpos: Array, qvel: Array) -> None:
        """Start with states `qpos` (N, nq) and `qvel` (N, nv)."""
        self._tracked = tracked
        self.qpos = qpos.copy()
        """Positions (N, nq) of all joints."""
        self.qvel = qvel.copy()
        """Velocities (N, nv) of all joints."""

    @property
    def position(self) -> Array:
        """Positions (N, 3) of the chassis' frame [m]."""
        first = self._tracked.free[0]
        return self.qpos[:, first : first + 3]

    @property
    def quaternion(self) -> Array:
        """Attitudes (N, 4) of the chassis: w, x, y, z."""
        first = self._tracked.free[0] + 3
        return self.qpos[:, first : first + 4]

    @property
    def velocity(self) -> Array:
        """Velocities (N, 3) of the chassis' frame in the world [m/s]."""
        first = self._tracked.free[1]
        return self.qvel[:, first : first + 3]

    @property
    def rate(self) -> Array:
        """Angular velocities (N, 3) of the chassis in its own frame [rad/s]."""
        first = self._tracked.free[1] + 3
        return self.qvel[:, first : first + 3]

    @property
    def rotation(self) -> Array:
        """Axes of the chassis in the world, the columns of matrices (N, 3, 3)."""
        first = self._tracked.free[0] + 3
        w, x, y, z = self.qpos[:, first : first + 4].T
        rows = (
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        )
        return np.moveaxis(np.array(rows), -1, 0)

    @property
    def heading(self) -> Array:
        """Headings (N,), from -pi to pi [rad]."""
        forwards = self.rotation[:, :, 0]
        return np.arctan2(forwards[:, 1], forwards[:, 0])

    @property
    def pitch(self) -> Array:
        """Angles (N,) by which the chassis points upwards [rad]."""
        return np.arcsin(np.clip(self.rotation[:, 2, 0], -1.0, 1.0))

    @property
    def roll(self) -> Array:
        """Angles (N,) by which the chassis leans to its right [rad]."""
        return np.arcsin(np.clip(-self.rotation[:, 2, 1], -1.0, 1.0))

    @property
    def upright(self) -> Array:
        """Cosines (N,) of the angles between the chassis' and the world's vertical."""
        return self.rotation[:, 2, 2]

    @property
    def flippers(self) -> Array:
        """Angles (N, F) of the flippers, tips up [rad]."""
        return self._tracked.flipper_angles(self.qpos)
