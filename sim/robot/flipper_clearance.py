"""Angles at which the flippers of a robot that stands level don't reach into the ground."""

from __future__ import annotations

import mujoco
import numpy as np

from sim.robot.tracked_model import TrackedModel
from trackslip.kinematics import Array

_STEPS = 61  # from the angle asked for to the highest


def clear_angles(tracked: TrackedModel, angles: Array) -> Array:
    """Angles (F,), lifted from `angles` (F,) as far as it takes not to reach below the chassis' tracks [rad].

    Flippers that reach below them at every higher angle stay where they are.
    """
    asked = np.clip(angles, *tracked.flipper_range.T)
    tried = np.linspace(asked, tracked.flipper_range[:, 1], _STEPS)  # (K, F)
    clear = _lowest(tracked, tried) >= tracked.robot.lowest  # (K, F)
    first = np.where(clear.any(axis=0), clear.argmax(axis=0), 0)
    return np.asarray(tried[first, np.arange(len(asked))])


def _lowest(tracked: TrackedModel, angles: Array) -> Array:
    """Heights (K, F) of the lowest points of flippers above the chassis' frame, at angles (K, F) [m]."""
    model, flippers = tracked.model, tracked.robot.flippers
    data = mujoco.MjData(model)
    low = np.empty(angles.shape)
    for k, one in enumerate(angles):
        data.qpos[tracked.flipper_qpos] = tracked.flipper_control(one)
        mujoco.mj_kinematics(model, data)
        for j, flipper in enumerate(flippers):
            x, z, radius = np.array(flipper.hull).T
            body = model.body(flipper.body).id
            up = data.xmat[body].reshape(3, 3)[2]
            height = data.xpos[body, 2] - data.xpos[tracked.body, 2] + up[0] * x + up[1] * flipper.y + up[2] * z
            low[k, j] = (height - radius).min()
    return low
