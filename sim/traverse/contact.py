"""Track contacts: means over a control period, and points and forces in a state."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.robot.tracked_model import TrackedModel
from sim.tracks import Reading
from trackslip.kinematics import Array

_STILL = 1e-3  # belt speed below which slip is not defined [m/s]


@dataclass
class TrackContact:
    """Contacts of the T tracks of N robots over a control period, (N, T) each."""

    traction: Array  # mean force of the ground along the belt, positive forwards [N]
    load: Array  # mean normal force [N]
    belt: Array  # mean belt speed [m/s]
    slip: Array  # 1 - speed over ground / belt speed while it touched; NaN where it did not, or the belt stood [-]
    touching: NDArray[np.bool_]  # whether it touched the ground
    depth: Array  # largest penetration [m]
    work: Array  # of the belts against the ground [J]

    @classmethod
    def none(cls, size: int, tracks: int) -> TrackContact:
        """Tracks that have not touched anything."""
        zero = np.zeros((size, tracks))
        return cls(zero, zero.copy(), zero.copy(), np.full(zero.shape, np.nan), zero > 0, zero.copy(), zero.copy())

    @classmethod
    def mean(cls, reading: Reading, step: float) -> TrackContact:
        """Means of a reading (N, steps, T) of physics steps of `step` [s]."""
        belt, touching = reading.belt, reading.touching
        slid, driven = (np.where(touching, values, 0.0).sum(axis=1) for values in (reading.sliding, belt))
        touched: NDArray[np.bool_] = np.logical_or.reduce(touching, axis=1)
        defined = touched & (np.abs(driven) > _STILL * belt.shape[1])
        slip = np.divide(slid, driven, out=np.full(slid.shape, np.nan), where=defined)
        work = (reading.traction * belt).sum(axis=1) * step
        traction, load, mean = (values.mean(axis=1) for values in (reading.traction, reading.load, belt))
        return cls(traction, load, mean, slip, touched, reading.depth.max(axis=1), work)

    def put(self, rows: NDArray[np.int_], other: TrackContact) -> None:
        """Replace the robots `rows` (R,) by the R robots of another."""
        for name, values in vars(other).items():
            getattr(self, name)[rows] = values

    def clear(self, rows: NDArray[np.int_]) -> None:
        """Reset the robots `rows` (R,)."""
        self.put(rows, TrackContact.none(len(rows), self.load.shape[1]))


class ContactPoints:
    """Contacts of a robot with the world, as the engine computes them in a state."""

    def __init__(self, world: TrackedModel) -> None:
        self._world = world
        self._data = mujoco.MjData(world.model)
        self._belts = world.belts

    def at(self, qpos: Array, qvel: Array, belt: Array, flippers: Array) -> tuple[Array, Array]:
        """Points (n, 3) [m] and forces (n, 3) of the ground on the robot [N], in the world.

        They are those of joint positions (nq,) and velocities (nv,), belt speeds (T,) [m/s] and set points (F,) of the
        flippers, tips up [rad].
        """
        model, data = self._world.model, self._data
        data.qpos[:], data.qvel[:] = qpos, qvel
        data.ctrl[self._world.flipper_motor] = self._world.flipper_control(flippers)
        self._belts.set(belt)
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
