"""MuJoCo's batch of simulations, with short forms of the calls that few robots make most often."""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco import batch

from trackslip.kinematics import Array

_KNOWN = mujoco.__version__.startswith("4.0.")
_CONTROLS = int(mujoco.mjtState.mjSTATE_CTRL)


class QuickBatch(batch.Batch):  # type: ignore[misc]  # MuJoCo has no type hints
    """A `mujoco.batch.Batch` of N simulations.

    `Batch.ray` and `Batch.rollout` prepare their arguments in Python, which takes longer than sixty rays and a tenth as
    long as the physics of a servo period. The short forms hand arrays that need no preparation to what is below, `_b`.
    That isn't part of MuJoCo's interface, so versions in which it may have changed get the long way round.
    """

    def record_sensors(self, into: Array, ids: np.ndarray | None = None) -> None:
        """Advance the n simulations `ids`, or all, by T physics steps.

        After each, `sensordata` is written `into` (n, T, sensors), a contiguous array.
        """
        steps = into.shape[1]
        if _KNOWN and ids is None:
            self._check(None, self._b.rollout(None, steps, None, _CONTROLS, [("sensordata", 0, into)]))
        else:
            self.rollout(steps, record=("sensordata",), ids=ids, out={"sensordata": into})

    def cast(self, origins: Array, directions: Array, groups: np.ndarray, exclude: int) -> Array:
        """Distances (N, W) along rays (N, W, 3) to geoms of `groups` (6,), but not of a body; -1 for a miss [m]."""
        if not _KNOWN:
            return np.asarray(self.ray(origins, directions, geomgroup=groups, bodyexclude=exclude)[0])
        origins, directions = np.ascontiguousarray(origins), np.ascontiguousarray(directions)
        groups = np.ascontiguousarray(groups, dtype=np.uint8)
        distance = np.empty(directions.shape[:2])
        hit, excluded = np.empty((2, *distance.shape), np.int32)
        excluded.fill(exclude)
        self._check(None, self._b.ray(None, origins, directions, groups, True, excluded, distance, hit, None))
        return distance
