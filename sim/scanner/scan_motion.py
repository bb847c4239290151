"""Motion of the robot during a scan: each beam sees the robot where it is at that beam's time.

Instead of the plate, the beams are moved: a ray transformed by the inverse of the plate's motion hits the plate at its
pose at the scan's time, at the same range at which the true ray hits the plate at its pose at the beam's time.
"""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array


def moved_back(origin: Array, rays: Array, pose: Array, twist: Array, lag: Array) -> tuple[Array, Array]:
    """Origins and directions (N, W, K, 3) of rays, relative to robots whose twist is constant during the scan.

    The true rays start at `origin` (3,) [m] and have the directions `rays` (N, W, K, 3); their times relative to the
    scan's are `lag` (N, W) [s]. The robots have `pose` (N, 3) at the scan's time [m, m, rad], and `twist` (N, 3):
    forward and lateral speed [m/s], yaw rate [rad/s].
    """
    forward, left, yaw_rate = (part[:, None] for part in twist.T)
    turn = -yaw_rate * lag
    cos, sin = np.cos(turn), np.sin(turn)
    # displacement by a constant twist in the time -lag, in the robot's frame
    ahead, aside = np.sinc(turn / np.pi), np.sin(turn / 2) * np.sinc(turn / (2 * np.pi))
    way = -lag[..., None] * np.stack([ahead * forward - aside * left, aside * forward + ahead * left], axis=-1)

    x, y, heading = (part[:, None] for part in pose.T)
    from_x, from_y = origin[0] - x, origin[1] - y
    h_cos, h_sin = np.cos(heading), np.sin(heading)
    origins = np.broadcast_to(origin, (*rays.shape[:2], 1, 3)).copy()
    origins[..., 0, 0] = x + cos * from_x - sin * from_y + h_cos * way[..., 0] - h_sin * way[..., 1]
    origins[..., 0, 1] = y + sin * from_x + cos * from_y + h_sin * way[..., 0] + h_cos * way[..., 1]
    cos, sin = cos[..., None], sin[..., None]
    x, y, z = np.moveaxis(rays, -1, 0)
    directions = np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=-1)
    return np.broadcast_to(origins, rays.shape), directions
