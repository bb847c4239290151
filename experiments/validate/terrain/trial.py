"""N copies of a robot side by side, level ground and a single step for them, and the search for a limit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from mujoco import batch

from experiments.validate.terrain.subjects import TerrainRobot
from trackslip.kinematics import Array

FACE = 0.5
"""Place of the step's face, x [m]."""
STEP = "step"
"""Name of the step's geom."""
_SIZE = 50.0  # half of what isn't seen to end [m]
_DEPTH = 0.5  # half of the height of boxes [m]


@dataclass(frozen=True)
class LevelGround:
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
        return [*LevelGround().add_to(spec), STEP]


def set_heights(model: mujoco.MjModel, batch: Any, height: np.ndarray) -> None:
    """Give the steps of N simulations their heights (N,) [m]."""
    batch.expand("geom_pos")[:, model.geom(STEP).id, 2] = height - _DEPTH


@dataclass(frozen=True)
class Limit:
    """The largest angle [rad] or height [m] that a robot can do."""

    found: float
    expected: float
    """By theory."""

    @property
    def error(self) -> float:
        """In the unit of both."""
        return self.found - self.expected


class TerrainTrial:
    """N robots that start at rest at the origin."""

    def __init__(self, stand: TerrainRobot, size: int, threads: int) -> None:
        """`size` robots on `threads` worker threads (0: one per processor)."""
        self.stand, self.size = stand, size
        self.batch = batch.Batch(stand.model, size, nthread=threads)
        self.belts = stand.belts.bind_batch(self.batch)
        self.batch.qpos[:] = stand.qpos
        if stand.model.nu:
            self.batch.ctrl[:] = stand.control
        position, velocity = stand.free
        self.position: Array = self.batch.qpos[:, position : position + 3]  # (N, 3), live
        self.quaternion: Array = self.batch.qpos[:, position + 3 : position + 7]  # (N, 4), live
        self.velocity: Array = self.batch.qvel[:, velocity : velocity + 3]  # (N, 3) in the world, live
        self.spin: Array = self.batch.qvel[:, velocity + 3 : velocity + 6]  # (N, 3) in the robot's frame, live
        self._gravity: Array | None = None

    @property
    def timestep(self) -> float:
        """The physics step [s]."""
        return float(self.stand.model.opt.timestep)

    def drive(self, speeds: Array) -> None:
        """Set the belts' speeds, (2,) or (N, 2), left and right [m/s]; flippers' belts follow their side."""
        each = np.broadcast_to(np.asarray(speeds, float), (self.size, 2))
        self.belts.set(each[:, self.stand.track_side])

    def tilt(self, slope: Array, uphill: Array | float = 0.0) -> None:
        """Turn gravity as on slopes (N,) that rise in the directions `uphill` (N,) of the ground's frame [rad]."""
        if self._gravity is None:
            self._gravity = self.batch.expand("opt.gravity")
        size = float(np.linalg.norm(self.stand.model.opt.gravity))
        down = size * np.sin(slope)
        self._gravity[:] = np.column_stack(
            [-down * np.cos(uphill), -down * np.sin(uphill), np.broadcast_to(-size * np.cos(slope), (self.size,))]
        )

    def turn_to(self, heading: Array) -> None:
        """Point the robots in directions (N,) [rad]."""
        self.quaternion[:] = 0.0
        self.quaternion[:, 0], self.quaternion[:, 3] = np.cos(heading / 2), np.sin(heading / 2)

    def advance(self, duration: float, rows: np.ndarray | None = None) -> None:
        """Simulate all robots, or those of `rows` (N,) bool [s]."""
        self.batch.step(ids=rows, nstep=max(1, round(duration / self.timestep)))

    def heading(self) -> Array:
        """Headings (N,) from -pi to pi [rad]."""
        w, x, y, z = self.quaternion.T
        return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

    def centre_of_mass(self) -> Array:
        """Places (N,) of the centres of mass along x [m]."""
        w, x, y, z = self.quaternion.T
        ahead, up = self.stand.view.centre_of_mass
        return self.position[:, 0] + ahead * (1 - 2 * (y * y + z * z)) + up * 2 * (x * z + w * y)

    def leaning(self) -> Array:
        """Angles (N,) between the robots' vertical axes and the ground's normal [rad]."""
        _, x, y, _ = self.quaternion.T
        return np.arccos(np.clip(1 - 2 * (x * x + y * y), -1, 1))


def limit(holds: Callable[[Array], np.ndarray], low: float, high: float, rows: int, rounds: int) -> float:
    """The value from `low` to `high` up to which `holds` is true; NaN unless it is at `low` and isn't at `high`.

    Args:
        holds: what holds at values (rows,); called once a round, whose values divide the interval of the last.
        low, high: where to look.
        rows: values per round.
        rounds: number of rounds.
    """
    for k in range(rounds):
        values = np.linspace(low, high, rows) if k == 0 else np.linspace(low, high, rows + 2)[1:-1]
        held = holds(values)
        first = rows if held.all() else int(np.argmin(held))
        if k == 0 and first in (0, rows):
            return float("nan")
        low, high = (
            float(values[first - 1]) if first > 0 else low,
            float(values[first]) if first < rows else high,
        )
    return (low + high) / 2
