"""Layout of the observations, float32 (9 + 2 K,) for K previews: errors, twists of the reference, speeds, last action.

The errors are those of the observed pose, reference minus robot (Eq. 18 of the paper); the heading error is wrapped.
A robot that drives along a slope crabs: with a compensation of slip under load, its heading is the direction in which
it moves. Sprocket speeds are means over the last control period, from the encoders. At the start of an episode the
sprockets are at rest and the last action is zero. With `EnvConfig.loads`, two elements more are the tractions that the
robot needs over the load on its tracks, because of slope and pull.
"""

from __future__ import annotations

import numpy as np

from sim.path_tracking.config import PERIOD, EnvConfig
from sim.task import Element
from trackslip.kinematics import Array

_BOUND = 2.0
_LOAD, _WHERE = 0.5, ("ahead", "to the left")


class TrackingLayout:
    """Elements of an observation, (9 + 2K)."""

    def __init__(self, config: EnvConfig, top_speed: float) -> None:
        """`top_speed`: of the sprockets [rad/s]."""
        self.steps = np.arange(config.previews + 1) * config.stride
        """Look-ahead of the observed reference twists (K + 1,) [control periods]."""
        speed, rate = config.twist_scale
        times = ["now" if step == 0 else f"in {step * PERIOD:g} s" for step in self.steps]
        self.elements = (
            Element("position error, ahead", "m", config.off_path, _BOUND),
            Element("position error, to the left", "m", config.off_path, _BOUND),
            Element("heading error", "rad", np.pi),
            *(
                element
                for time in times
                for element in (
                    Element(f"reference speed {time}", "m/s", speed, _BOUND),
                    Element(f"reference yaw rate {time}", "rad/s", rate, _BOUND),
                )
            ),
            *(Element(f"{side} sprocket speed", "rad/s", top_speed, _BOUND) for side in ("left", "right")),
            *(Element(f"last action, {which}", "-", 1.0) for which in ("first", "second")),
            *(Element(f"load, {where}", "-", _LOAD, _BOUND) for where in _WHERE if config.loads),
        )
        """Names, units, scales and bounds."""
        self._scale = np.array([[element.scale for element in self.elements]])  # (1, n)
        self._bound = np.array([element.bound for element in self.elements], np.float32)

    def observation(self, error: Array, twist: Array, omega: Array, action: Array, load: Array | None = None) -> Array:
        """Observations (N, n) of errors (N, 3), twists (N, K + 1, 2), sprocket speeds, actions and loads (N, 2)."""
        parts = error, twist.reshape(len(error), -1), omega, action, *(() if load is None else (load,))
        whole = np.concatenate(parts, axis=1) / self._scale
        return np.minimum(np.maximum(whole.astype(np.float32), -self._bound), self._bound)
