"""N simulations of a model in a batch, and the states of their robots."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
from mujoco import batch
from numpy.typing import NDArray

from trackslip import se2
from trackslip.errors import require, require_positive, require_whole
from trackslip.kinematics import Array
from trackslip.restorable import Restorable

_ROUNDING: Final = 1e-9  # tolerance on times [s]


class _Silence:
    """The settings of the process's engine log, from before the first thread silenced it."""

    lock = threading.Lock()
    threads = 0
    before: mujoco.MjLogConfig


@contextmanager
def quietly() -> Iterator[None]:
    """Silence the engine's warnings, on the console and in MUJOCO_LOG.TXT; callers read the
    engine's counters.
    """
    with _Silence.lock:
        if _Silence.threads == 0:
            _Silence.before = mujoco.MjLogConfig.get()
            quiet = mujoco.MjLogConfig.get()
            quiet.logto_console = False
            quiet.logto_file = False
            quiet.set()
        _Silence.threads += 1
    try:
        yield
    finally:
        with _Silence.lock:
            _Silence.threads -= 1
            if _Silence.threads == 0:
                _Silence.before.set()


@dataclass(frozen=True)
class States:
    """States of robots with leading axes (...): N robots at one time, or N robots at T times."""

    qpos: Array  # (..., nq) positions of all joints
    qvel: Array  # (..., nv) velocities of all joints
    # indices at which the chassis' pose begins in qpos, and its velocity in qvel
    free: tuple[int, int] = (0, 0)

    @property
    def position(self) -> Array:
        """Positions (..., 3) of the chassis [m]."""
        first = self.free[0]
        return self.qpos[..., first : first + 3]

    @property
    def quaternion(self) -> Array:
        """Attitudes (..., 4) of the chassis as quaternions w, x, y, z."""
        first = self.free[0] + 3
        return self.qpos[..., first : first + 4]

    @property
    def _components(self) -> tuple[Array, Array, Array, Array]:
        """The components w, x, y, z (...) of the quaternions; `np.moveaxis` is slow."""
        quaternion = self.quaternion
        return quaternion[..., 0], quaternion[..., 1], quaternion[..., 2], quaternion[..., 3]

    @property
    def velocity(self) -> Array:
        """Velocities (..., 3) of the chassis in the world [m/s]."""
        first = self.free[1]
        return self.qvel[..., first : first + 3]

    @property
    def rate(self) -> Array:
        """Angular velocities (..., 3) of the chassis in its own frame [rad/s]."""
        first = self.free[1] + 3
        return self.qvel[..., first : first + 3]

    @property
    def rotation(self) -> Array:
        """Matrices (..., 3, 3) whose columns are the chassis' axes in the world: forwards, to the
        left, up.
        """
        w, x, y, z = self._components
        rows = (
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        )
        return np.moveaxis(np.array(rows), (0, 1), (-2, -1))

    @property
    def heading(self) -> Array:
        """Headings (...), from -pi to pi [rad]."""
        w, x, y, z = self._components
        return np.asarray(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))

    @property
    def upright(self) -> Array:
        """Cosines (...) of the angles between the chassis' vertical and the world's."""
        _, x, y, _ = self._components
        return np.asarray(1 - 2 * (x * x + y * y))

    @property
    def pitch(self) -> Array:
        """Angles (...) by which the chassis points upwards [rad]."""
        return np.asarray(np.arcsin(np.clip(self.rotation[..., 2, 0], -1.0, 1.0)))

    @property
    def roll(self) -> Array:
        """Angles (...) by which the chassis leans to its right [rad]."""
        left, up = np.moveaxis(self.rotation[..., 2, 1:], -1, 0)
        return np.asarray(np.arctan2(left, up))

    @property
    def twist(self) -> Array:
        """Twists (..., 3): forward speed, lateral speed to the left [m/s], yaw rate [rad/s]."""
        along = se2.rotate(-self.heading, self.velocity[..., :2])
        return np.concatenate([along, self.rate[..., 2:]], axis=-1)

    def lean(self, height: float) -> Array:
        """Leftward offset (...) of the chassis' vertical axis at a `height` above the ground
        [m].
        """
        x, y, z = np.moveaxis(self.rotation[..., 2], -1, 0)
        distance = (height - self.position[..., 2]) / z  # along the axis
        heading = self.heading
        leftward = np.cos(heading) * y - np.sin(heading) * x
        return np.asarray(distance * leftward)


class Simulations(Restorable):
    """N simulations of a robot, each in its own world; rows are bitwise independent."""

    def __init__(
        self, model: mujoco.MjModel, size: int, threads: int, free: tuple[int, int] = (0, 0)
    ) -> None:
        """Create `size` simulations of a model on `threads` worker threads (0: one per processor);
        `free` as in States.

        Raises InvalidValueError for fewer than one simulation or a negative number of threads.
        """
        require_whole("size", size, 1)
        require_whole("threads", threads, 0)
        self.size = size
        self.batch = batch.Batch(model, size, nthread=threads)
        """The engine's simulations."""
        if model.nkey:
            self.batch.qpos[0] = model.key_qpos[0]
            self.batch.ctrl[0] = model.key_ctrl[0]
        self._fresh = self.batch.state[0].copy()  # state of a robot before it moves
        self.state = States(self.batch.qpos, self.batch.qvel, free)
        """States (N, ...) of the robots, views of the batch."""

    def _set_payload(
        self, rows: NDArray[np.int_], body: int, mass: Array, com_offset: Array
    ) -> None:
        """Scale the mass and inertia of a body by `mass` (R,), and shift its centre of mass by
        `com_offset` (R, 2) [m].

        The shift is forwards and to the left. The belts must be moving during the call, otherwise
        the engine concludes that they never move.
        """
        changes = not (mass == 1).all() or com_offset.any()
        has_changed = self.batch.expanded("body_mass") is not None
        if not changes and not has_changed:
            return
        model = self.batch.model
        masses = self.batch.expand("body_mass")
        inertias = self.batch.expand("body_inertia")
        centres = self.batch.expand("body_ipos")
        masses[rows, body] = model.body_mass[body] * mass
        inertias[rows, body] = model.body_inertia[body] * mass[:, None]
        centres[rows, body, :2] = model.body_ipos[body, :2] + com_offset
        self.batch.set_const(ids=rows)

    def get_state(self) -> dict[str, Any]:
        """Return a copy of the state, with the engine's state and the model fields that differ
        between simulations.
        """
        expanded = {name: self.batch.expanded(name) for name in batch.MODEL_FIELDS}
        model = {name: values.copy() for name, values in expanded.items() if values is not None}
        engine = {
            "state": self.batch.state.copy(),
            "warning": self.batch.warning.copy(),
            "model": model,
        }
        return super().get_state() | {"engine": engine}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a state; quantities that the engine derives from it are up to date after the next
        step.
        """
        super().set_state(state)
        engine = state["engine"]
        self.batch.state[:] = engine["state"]
        self.batch.warning[:] = engine["warning"]
        for name in batch.MODEL_FIELDS:
            if name in engine["model"]:
                self.batch.expand(name)[...] = engine["model"][name]
            elif self.batch.expanded(name) is not None:  # equal in all simulations at that time
                model = self.batch.model
                owner = model.opt if name.startswith("opt.") else model
                self.batch.expand(name)[...] = getattr(owner, name.split(".")[-1])

    def _place_at(self, rows: np.ndarray, poses: Array, height: Array | float = 0.0) -> None:
        """Reset the robots `rows` (R,) to upright poses (R, 3) [m, m, rad], with frames at heights
        (R,) [m].
        """
        self.batch.state[rows] = self._fresh
        half_heading = poses[:, 2] / 2
        placed = np.zeros((len(rows), 7))  # x, y, z and a quaternion w, x, y, z
        placed[:, :2] = poses[:, :2]
        placed[:, 2] = height
        placed[:, 3] = np.cos(half_heading)
        placed[:, 6] = np.sin(half_heading)
        first = self.state.free[0]
        self.batch.qpos[rows, first : first + 7] = placed


def steps_in(name: str, period: float, of: str, step: float) -> int:
    """Number of steps in a period [s]; raises InvalidValueError unless it is a multiple of `step`
    [s], named `of`.
    """
    require_positive(name, period)
    count = round(period / step)
    is_multiple = count >= 1 and abs(count * step - period) < _ROUNDING
    require(is_multiple, name, period, f"a multiple of {of}, {step:g} s")
    return count
