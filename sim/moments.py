"""What the engine knows of robots at a moment, or at many, and what follows from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array, column, columns, in_frame


@dataclass(frozen=True)
class Moments:
    """States of robots and the forces on them, (...) each: of N robots now, or of N robots at T moments."""

    place: Array  # (..., 7) position of the chassis [m] and its quaternion
    velocity: Array  # (..., 6) in the world [m/s], turning in the robot's frame [rad/s]
    heading: Array  # (...) unwrapped [rad]
    forces: Array  # (..., 6) on the left and on the right track [N]
    forward: Array  # (..., 2) x axes of the chassis

    def copied(self) -> tuple[Array, ...]:
        """Copies of the arrays, in order."""
        return tuple(values.copy() for values in vars(self).values())

    def pose(self) -> Array:
        """Poses (..., 3) of the chassis [m, m, rad]; phi unwrapped."""
        pose = np.empty((*self.heading.shape, 3))
        pose[..., :2], pose[..., 2] = self.place[..., :2], self.heading
        return pose

    def twist(self) -> Array:
        """Twists (..., 3): forward speed, lateral speed to the left [m/s], yaw rate [rad/s]."""
        x, y, _, _, _, yaw_rate = columns(self.velocity)
        twist = np.empty((*self.heading.shape, 3))
        twist[..., 0], twist[..., 1] = in_frame(column(self.heading), x, y)
        twist[..., 2] = yaw_rate
        return twist

    def traction(self) -> Array:
        """Longitudinal forces of the ground on the (left, right) tracks in the last physics step, (..., 2) [N]."""
        return along_robot(self.forces, self.forward)

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
