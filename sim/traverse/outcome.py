"""Outcomes of runs over courses, the limits that determine them, and contact points."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.robot.tracked_model import TrackedModel
from sim.robot.urdf import engine_errors
from trackslip.errors import Checked, checked, require_positive
from trackslip.kinematics import Array
from trackslip.restorable import Restorable

Outcomes = NDArray[np.int_]
"""Outcomes (N,), as the numbers in `Outcome`."""
# mean travel of left and right belts below which a robot is waiting or turning [m]
_WAITING: Final = 0.1
# ratio of a robot's displacement to its belt travel below which it is stuck [-]
_STUCK: Final = 0.1


class Outcome(IntEnum):
    """State or end of a run. If several outcomes apply, the last of them in this list counts."""

    DRIVING = 0
    """The run continues."""
    TIME = 1
    """The time limit has been reached."""
    STUCK = 2
    """The belts ran, but the robot made no progress."""
    REACHED = 3
    """The robot has crossed the course."""
    FELL = 4
    """The robot fell off the course."""
    TIPPED = 5
    """The robot tipped over."""
    EXPLODED = 6
    """The simulation diverged: the robot is implausibly fast or its state isn't finite."""

    @property
    def label(self) -> str:
        """The outcome's name in lower case, as it is printed and stored."""
        return self.name.lower()


@dataclass(frozen=True)
class Limits(Checked):
    """The limits that end a run."""

    time: float = checked(60.0, require_positive, 1e6)
    """Longest duration of a run [s]."""
    stuck_time: float = checked(5.0, require_positive, 1e6)
    """Time after which a robot is stuck if its belts run without progress [s]."""


class StuckWatch(Restorable):
    """Detection of robots that make no progress although their belts run."""

    STATE = ("_position", "_travel", "_age", "_travelled")

    def __init__(self, limits: Limits, size: int, period: float) -> None:
        """Watch `size` robots, observed once per control `period` [s]."""
        self._period = period
        self._history = max(1, round(limits.stuck_time / period))
        self._position: deque[Array] = deque(maxlen=self._history + 1)  # (N, 3) each [m]
        # (N,) each, since the first observation [m]
        self._travel: deque[Array] = deque(maxlen=self._history + 1)
        # control periods since the start of each run
        self._age: NDArray[np.int_] = np.zeros(size, int)
        self._travelled: Array = np.zeros(size)

    def begin(self, rows: NDArray[np.int_]) -> None:
        """Begin new runs with the robots `rows` (R,)."""
        self._age[rows] = 0

    def observe(self, position: Array, belts: Array) -> NDArray[np.bool_]:
        """Mask (N,) of stuck robots, given positions (N, 3) [m] and belt speeds (N, 2) in the last
        period [m/s].
        """
        self._travelled = self._travelled + (belts[:, 0] + belts[:, 1]) * (self._period / 2)
        self._position.append(position.copy())
        self._travel.append(self._travelled)
        self._age += 1
        moved = np.linalg.norm(position - self._position[0], axis=1)
        travelled = np.abs(self._travelled - self._travel[0])
        is_waiting = travelled < _WAITING
        is_moving = moved >= _STUCK * travelled
        return (self._age > self._history) & ~is_waiting & ~is_moving


class ContactPoints:
    """A robot's contacts with the world in a given state, as the engine computes them."""

    def __init__(self, world: TrackedModel) -> None:
        self._world = world
        self._data = mujoco.MjData(world.model)
        self._belts = world.belts

    def at(self, qpos: Array, qvel: Array, belt: Array, flippers: Array) -> tuple[Array, Array]:
        """Contact points (n, 3) [m] and forces (n, 3) [N] from the ground on the robot, in the
        world frame.

        The state consists of joint positions (nq,) and velocities (nv,), belt speeds (T,) [m/s] and
        the flippers' set points (F,), tips up [rad].
        """
        model = self._world.model
        data = self._data
        data.qpos[:] = qpos
        data.qvel[:] = qvel
        data.ctrl[self._world.flipper_motor] = self._world.flipper_control(flippers)
        self._belts.set(belt)
        with engine_errors(self._world.robot.model):
            mujoco.mj_forward(model, data)
        contact = data.contact
        # (n, 2), whether each geom belongs to the world
        is_fixed = model.geom_bodyid[contact.geom.reshape(-1, 2)] == 0
        is_active = contact.efc_address >= 0
        chosen = np.flatnonzero(is_fixed.any(axis=1) & is_active)
        points = contact.pos[chosen].copy()
        force = np.zeros((len(chosen), 3))
        wrench = np.zeros(6)
        for k, which in enumerate(chosen):
            mujoco.mj_contactForce(model, data, which, wrench)
            force[k] = wrench[:3] @ contact.frame[which].reshape(3, 3)
        # the engine reports the force on the second geom
        sign = np.where(is_fixed[chosen, 1:], -1.0, 1.0)
        return points, sign * force
