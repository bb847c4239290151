"""Where a robot touches the ground and how hard, found again from its recorded state."""

from __future__ import annotations

import mujoco
import numpy as np

from sim.robot.tracked_model import TrackedModel
from sim.tracks import bind
from trackslip.kinematics import Array


class ContactPoints:
    """Contacts of a robot with the world, as the engine computes them in a state."""

    def __init__(self, world: TrackedModel) -> None:
        self._world = world
        self._data = mujoco.MjData(world.model)
        self._belts = bind(world.model, *world.tracks)

    def at(self, qpos: Array, qvel: Array, belt: Array, flippers: Array) -> tuple[Array, Array]:
        """Points (n, 3) [m] and forces (n, 3) of the ground on the robot [N], in the world.

        Args:
            qpos: positions (nq,) of all joints.
            qvel: velocities (nv,).
            belt: speeds (T,) of the belts [m/s].
            flippers: set points (F,) of the flippers, tips up [rad].
        """
        model, data = self._world.model, self._data
        data.qpos[:], data.qvel[:] = qpos, qvel
        data.ctrl[self._world.flipper_motor] = self._world.flipper_control(flippers)
        self._belts.set(model, belt)
        mujoco.mj_forward(model, data)
        contact = data.contact
        fixed = model.geom_bodyid[contact.geom.reshape(-1, 2)] == 0  # (n, 2)
        chosen = np.flatnonzero(fixed.any(axis=1) & (contact.efc_address >= 0))
        force, points = np.zeros((len(chosen), 3)), contact.pos[chosen].copy()
        wrench = np.zeros(6)
        for k, which in enumerate(chosen):
            mujoco.mj_contactForce(model, data, which, wrench)
            force[k] = wrench[:3] @ contact.frame[which].reshape(3, 3)
        return points, np.where(fixed[chosen, 1:], -1.0, 1.0) * force  # the engine's is on the second geom
