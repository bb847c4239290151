"""Classical controllers as policies, observation -> action: to be imitated, or compared where policies are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sim.path_tracking.config import EnvConfig
from trackslip.controllers.base import Controller
from trackslip.controllers.feedforward import Feedforward
from trackslip.controllers.kanayama import Kanayama
from trackslip.controllers.linear import LinearTimeVarying
from trackslip.controllers.offset_point import OffsetPoint
from trackslip.controllers.samson import Samson
from trackslip.errors import InvalidValueError
from trackslip.kinematics import Array

IMITABLE = (Feedforward, LinearTimeVarying, Samson, Kanayama, OffsetPoint)
"""Controllers that need nothing but the errors and the reference's twist of the moment."""


class ControllerPolicy:
    """What a controller would do, seeing what an agent of the environment with twists for actions sees.

    An observation cuts errors off at its bounds, and so does this.
    """

    def __init__(self, controller: Controller, config: EnvConfig) -> None:
        """`controller`, one of IMITABLE; raises InvalidValueError for others and for an environment without twists."""
        if not isinstance(controller, IMITABLE):
            names = ", ".join(kind.__name__ for kind in IMITABLE)
            raise InvalidValueError("controller", type(controller).__name__, f"one that looks at now only: {names}")
        if config.action != "twist":
            raise InvalidValueError("action", config.action, '"twist"')
        self._controller, self._config = controller, config
        self._scale = np.array(config.twist_scale)

    def action(self, observation: ArrayLike) -> Array:
        """Actions (N, 2) in [-1, 1] for observations (N, n)."""
        seen = np.asarray(observation, float)
        error = seen[:, :3] * [self._config.off_path, self._config.off_path, np.pi]
        # in the robot's frame the robot is at the origin, and the reference where the errors say
        moments = map(_Moment, error, seen[:, 3:5] * self._scale)
        twist = np.array([self._controller.twist(0.0, np.zeros(3), moment) for moment in moments])
        return np.clip(twist / self._scale, -1.0, 1.0)


@dataclass(frozen=True)
class _Moment:
    """A reference at one moment."""

    where: Array  # (3,)
    motion: Array  # (2,)
    duration: float = np.inf

    def pose(self, time: ArrayLike) -> Array:
        """The pose (3,)."""
        return self.where

    def twist(self, time: ArrayLike) -> Array:
        """The twist (2,)."""
        return self.motion
