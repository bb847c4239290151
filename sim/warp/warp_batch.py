"""A batch of simulations that MuJoCo Warp steps, for fleets to use like MuJoCo's own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from mujoco import MjModel, batch

from sim.quick_batch import QuickBatch
from sim.warp.worlds import Worlds
from trackslip.errors import require
from trackslip.kinematics import Array

Ids = np.ndarray | Sequence[int] | None
"""Simulations, or None for all."""


class WarpBatch(QuickBatch):
    """A `mujoco.batch.Batch` that holds the states of N simulations, in double precision; MuJoCo Warp steps them.

    Rays are cast by MuJoCo. Fields of MjData that are bound follow `step` and `rollout` only.
    """

    def __init__(self, model: MjModel, nsim: int, nthread: int, device: str) -> None:
        """`nsim` simulations on a `device` of Warp; rays are cast on `nthread` threads, 0 for one per processor."""
        super().__init__(model, nsim, nthread)
        self._worlds = Worlds(model, nsim, device)
        self._fields: dict[str, np.ndarray] = {}  # of the model, per simulation
        self._outputs: dict[str, Array] = {}

    def bind(self, name: str) -> np.ndarray:
        """Return a live (N, ...) array over a field of MjData; fields that aren't of the state are read-only."""
        if name not in self._outputs:
            field = super().bind(name)
            if field.flags.writeable:  # of the state
                return field
            self._outputs[name] = np.zeros_like(field)
        shown = self._outputs[name].view()
        shown.flags.writeable = False
        return shown

    def expand(self, name: str) -> np.ndarray:
        """Give a field of the model per-simulation values (N, ...); raises InvalidValueError if Warp can't."""
        require(self._worlds.has(name), "field", name, "a field that MuJoCo Warp has per world")
        self._fields[name] = super().expand(name)
        return self._fields[name]

    def set_const(self, ids: Ids = None) -> None:
        """Run mj_setConst per simulation; the fields that it derives become per-simulation as well."""
        super().set_const(ids)
        for name in batch.MODEL_FIELDS:
            if name not in self._fields and self._worlds.has(name):
                values = self.expanded(name)
                if values is not None:
                    self._fields[name] = values

    def step(self, ids: Ids = None, nstep: int = 1) -> None:
        """Advance each simulation by `nstep` physics steps."""
        if nstep > 0:
            self.rollout(nstep, (), ids)

    def record_sensors(self, into: Array, ids: np.ndarray | None = None) -> None:
        """Advance the n simulations `ids`, or all; record `sensordata` after each of T steps `into` (n, T, sensors)."""
        self.rollout(into.shape[1], ids=ids, out={"sensordata": into})

    def rollout(
        self,
        nstep: int,
        record: Sequence[str] = ("sensordata",),
        ids: Ids = None,
        out: Mapping[str, np.ndarray] | None = None,
    ) -> dict[str, np.ndarray]:
        """Advance each simulation by `nstep` physics steps, recording fields of MjData after each.

        Returns the n simulations' fields, (n, nstep, ...) each, in single precision or in the arrays `out`.
        """
        rows = slice(None) if ids is None else np.asarray(ids)
        # the others are stepped, too, and forgotten
        state, records, last = self._worlds.step(self.state, self._fields, nstep, record, tuple(self._outputs))
        self.state[rows] = state[rows]
        for name, values in last.items():
            self._outputs[name][rows] = values[rows]
        recorded = {name: values.swapaxes(0, 1)[rows] for name, values in records.items()}
        for name, into in (out or {}).items():
            into[...] = recorded[name]
            recorded[name] = into
        return recorded
