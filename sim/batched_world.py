"""The batched world that fleets on flat ground and robots on terrain share: N simulations of one model."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np
from mujoco import batch

from sim.restorable import Restorable
from trackslip.errors import require
from trackslip.kinematics import Array


class _Silence:
    """What the engine's log was set to, for the whole process, before the first of the threads that silence it."""

    lock = threading.Lock()
    threads = 0
    before: mujoco.MjLogConfig


@contextmanager
def quietly() -> Iterator[None]:
    """Silence the engine's warnings, on the console and in MUJOCO_LOG.TXT; the caller reads their counters."""
    with _Silence.lock:
        if _Silence.threads == 0:
            _Silence.before, quiet = mujoco.MjLogConfig.get(), mujoco.MjLogConfig.get()
            quiet.logto_console = quiet.logto_file = False
            quiet.set()
        _Silence.threads += 1
    try:
        yield
    finally:
        with _Silence.lock:
            _Silence.threads -= 1
            if _Silence.threads == 0:
                _Silence.before.set()


class BatchedWorld(Restorable):
    """N simulations of one robot, each in its own world; rows are bitwise independent."""

    def __init__(self, model: mujoco.MjModel, size: int, threads: int, free: int = 0) -> None:
        """Make `size` simulations.

        Args:
            model: with one robot.
            size: number of simulations.
            threads: number of worker threads, 0 for one per processor.
            free: first number of the pose of the robot's frame in qpos.

        Raises:
            InvalidValueError: for fewer than one simulation or a negative number of threads.
        """
        require(size >= 1, "size", size, "at least 1")
        require(threads >= 0, "threads", threads, "0 (one per processor) or more")
        self.size = size
        self.batch = batch.Batch(model, size, nthread=threads)
        if model.nkey:
            self.batch.qpos[0], self.batch.ctrl[0] = model.key_qpos[0], model.key_ctrl[0]
        self._fresh = self.batch.state[0].copy()  # of a robot that has not moved yet
        self._pose = slice(free, free + 7)

    def get_state(self) -> dict[str, Any]:
        """See Restorable; with the engine's state, and the fields of its model that differ between simulations."""
        found = {name: self.batch.expanded(name) for name in batch.MODEL_FIELDS}
        model = {name: values.copy() for name, values in found.items() if values is not None}
        engine = {"state": self.batch.state.copy(), "warning": self.batch.warning.copy(), "model": model}
        return super().get_state() | {"engine": engine}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """See Restorable; what the engine derives from a state is up to date after the next step."""
        super().set_state(state)
        of, engine = self.batch, state["engine"]
        of.state[:], of.warning[:] = engine["state"], engine["warning"]
        for name in batch.MODEL_FIELDS:
            if name in engine["model"]:
                of.expand(name)[...] = engine["model"][name]
            elif of.expanded(name) is not None:
                plain = of.model.opt if name.startswith("opt.") else of.model
                of.expand(name)[...] = getattr(plain, name.split(".")[-1])

    def _place_at(self, rows: np.ndarray, poses: Array, height: Array | float = 0.0) -> None:
        """Reset the robots `rows` (R,), upright at poses (R, 3) [m, m, rad], their frames at heights (R,) [m]."""
        self.batch.state[rows] = self._fresh
        half, zero = poses[:, 2] / 2, np.zeros(len(rows))
        place = [*poses[:, :2].T, np.broadcast_to(height, zero.shape), np.cos(half), zero, zero, np.sin(half)]
        self.batch.qpos[rows, self._pose] = np.stack(place, axis=-1)
