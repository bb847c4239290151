"""Terrain of the checks that is simpler than a course: level ground and a single step."""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

FACE = 0.5
"""Where the face of the step is, x [m]."""
STEP = "step"
"""Name of the step's geom."""
_SIZE = 50.0  # half of what isn't seen to end [m]
_DEPTH = 0.5  # half of the height of boxes [m]


@dataclass(frozen=True)
class Level:
    """Level ground at z = 0."""

    friction: float = 0.7
    """Coefficient of friction [-]."""
    boxed: bool = False
    """A box, instead of a plane."""

    def add_to(self, spec: Any) -> list[str]:
        """See `sim.robot.tracked_model.Terrain`."""
        shape = (
            {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": [_SIZE, _SIZE, _DEPTH], "pos": [0, 0, -_DEPTH]}
            if self.boxed
            else {"type": mujoco.mjtGeom.mjGEOM_PLANE, "size": [_SIZE, _SIZE, 1]}
        )
        spec.worldbody.add_geom(name="ground", **shape)
        return ["ground"]


@dataclass(frozen=True)
class SingleStep:
    """Level ground, and a step whose height is set in the model."""

    friction: float
    """Coefficient of friction [-]."""

    def add_to(self, spec: Any) -> list[str]:
        """See `sim.robot.tracked_model.Terrain`."""
        size, pos = [_SIZE, _SIZE, _DEPTH], [FACE + _SIZE, 0, -_DEPTH]
        spec.worldbody.add_geom(name=STEP, type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=pos)
        return [*Level().add_to(spec), STEP]


def set_heights(model: mujoco.MjModel, batch: Any, height: np.ndarray) -> None:
    """Give the steps of N simulations their heights (N,) [m]."""
    batch.expand("geom_pos")[:, model.geom(STEP).id, 2] = height - _DEPTH
