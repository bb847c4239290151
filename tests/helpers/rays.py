"""Heights and normals of compiled models by MuJoCo's rays."""

import mujoco
import numpy as np

_HIGH = 30.0  # above everything [m]


def look_down(model, data, points):
    """Heights (P,) and normals (P, 3) where vertical rays at `points` (P, 2) hit."""
    heights, normals = np.empty(len(points)), np.empty((len(points), 3))
    down, geom = np.array([0.0, 0.0, -1.0]), np.zeros(1, np.int32)
    for k, (x, y) in enumerate(points):
        above = np.array([x, y, _HIGH])
        heights[k] = _HIGH - mujoco.mj_ray(model, data, above, down, None, 1, -1, geom, normals[k])
    return heights, normals
