"""N copies of a robot on its terrain, driven side by side in a batch; and the search for a limit with them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from mujoco import batch

from experiments.validation.terrain.subjects import Stand
from trackslip.kinematics import Array


class Trial:
    """N robots that start at rest at the origin."""

    def __init__(self, stand: Stand, size: int, threads: int) -> None:
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
        """Set the belts' speeds, (2,) or (N, 2), left and right [m/s]; flippers' belts run with those of their side."""
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
