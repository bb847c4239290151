"""Layout of the observations.

An observation is float32, (9 + 2 K,) for K previews; each element is divided by its scale and clipped to its bound:

    element     what                                                       scale                 bound
    0, 1        position error (e_x, e_y) in the robot's frame [m]         off_path              2
    2           heading error e_phi, wrapped [rad]                         pi                    1
    3, 4        reference twist (v, w) now [m/s, rad/s]                    twist_scale           2
    5, 6        reference twist one preview_spacing ahead                  twist_scale           2
    ...         and so on, K previews                                      twist_scale           2
    5 + 2K ..   sprocket speeds (left, right), from the encoders, mean     top speed of          2
                over the last control period [rad/s]                       the sprockets
    7 + 2K ..   the last action                                            1                     1

The errors are those of the observed pose, reference minus robot (Eq. 18 of the paper). At the start of an episode the
sprockets are at rest and the last action is zero.
"""

from __future__ import annotations

import numpy as np

from sim.path_tracking.config import EnvConfig
from trackslip.kinematics import Array

_BOUND = 2.0


class TrackingLayout:
    """Scales and bounds of an observation, (9 + 2K,) each."""

    def __init__(self, config: EnvConfig, top_speed: float) -> None:
        """`top_speed`: of the sprockets [rad/s]."""
        previews = config.previews
        self.steps = np.arange(previews + 1) * config.stride
        """Look-ahead of the observed reference twists (K + 1,) [control periods]."""
        of_pose, of_twists = (config.off_path, config.off_path, np.pi), config.twist_scale * (previews + 1)
        self._scale = np.array([[*of_pose, *of_twists, top_speed, top_speed, 1.0, 1.0]])  # (1, n)
        self.bound = np.array([_BOUND, _BOUND, 1.0, *[_BOUND] * (2 * previews + 4), 1.0, 1.0], np.float32)
        """Bounds (n,) of the observations."""

    def observation(self, error: Array, twist: Array, omega: Array, action: Array) -> Array:
        """Observations (N, n) of errors (N, 3), twists (N, K + 1, 2), sprocket speeds (N, 2) and actions (N, 2)."""
        whole = np.concatenate([error, twist.reshape(len(error), -1), omega, action], axis=1) / self._scale
        return np.minimum(np.maximum(whole.astype(np.float32), -self.bound), self.bound)
