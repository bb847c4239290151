"""N worlds of a model on a device of Warp: their state and model fields go there, are stepped and come back.

MuJoCo Warp computes in single precision. Positions would suffer from that: a robot that has gone 100 m moves by
multiples of 8 µm per step, which would falsify its speed. So the pose of the robot is integrated here, in double
precision, from the velocities that MuJoCo Warp finds; contacts and velocities are in single precision.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from sim.warp.kernels import integrate_pose, round_state, widen_state
from sim.warp.replayed import Replayed
from trackslip.errors import TrackslipError, require
from trackslip.kinematics import Array

_INTEGRATORS = (mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
_POINTS = {mujoco.mjtGeom.mjGEOM_SPHERE: 1, mujoco.mjtGeom.mjGEOM_CAPSULE: 2}
"""Most points at which a geom touches a plane."""
_MOST_POINTS = 8  # at which any other pair of geoms touches
_UNPAIRED = 32  # points to make room for where geoms touch that are in no pair
_SLOW = mjw.OverflowType.ITERATIONS | mjw.OverflowType.LS_ITERATIONS  # a solver that stops early lost no contact
_SIGNATURE = int(mujoco.mjtState.mjSTATE_INTEGRATION)


class Worlds:
    """N worlds on a device of Warp."""

    def __init__(self, model: mujoco.MjModel, size: int, device: str) -> None:
        """`size` worlds of a model on a `device` of Warp, "cuda" or "cpu".

        Raises:
            InvalidValueError: for a model whose pose isn't that of a free joint, or an integrator of higher order.
            TrackslipError: for a model with parts that MuJoCo Warp doesn't have, and without memory for the worlds.
        """
        free = model.njnt > 0 and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
        require(free, "model", "its first joint", "a free joint, to run on MuJoCo Warp")
        integrator = mujoco.mjtIntegrator(model.opt.integrator)
        allowed = "Euler or implicitfast, to run on MuJoCo Warp"
        require(integrator in _INTEGRATORS, "option.integrator", integrator.name.removeprefix("mjINT_"), allowed)
        wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)  # else it reports every kernel it compiles
        self._device = wp.get_device(device)
        self._size, self._timestep = size, float(model.opt.timestep)
        contacts, rows = _room(model)
        try:
            with wp.ScopedDevice(self._device):
                self._make(model, contacts, rows)
        except NotImplementedError as error:
            raise TrackslipError(f"MuJoCo Warp can't step this model: {error}") from error
        except RuntimeError as error:
            raise TrackslipError(f"no room for {size} robots on the device: {error}") from error
        self._buffers: dict[str, np.ndarray] = {}
        self._stages = self._new_stages()

    def _make(self, model: mujoco.MjModel, contacts: int, rows: int) -> None:
        self._model = mjw.put_model(model)
        # it would accept residuals that tilt a robot at rest by 0.02 mrad
        self._model.opt.tolerance.fill_(model.opt.tolerance)
        self._model.opt.warn_overflow = 0  # `_require_room` does
        if self._device.is_cuda:
            self._model.opt.graph_conditional = wp.is_conditional_graph_supported()
        self._data = mjw.make_data(model, nworld=self._size, nconmax=contacts, njmax=rows)
        width = mujoco.mj_stateSize(model, _SIGNATURE)
        self._state = wp.zeros((self._size, width), dtype=wp.float64)
        self._rounded = wp.zeros((self._size, width), dtype=wp.float32)

    def has(self, field: str) -> bool:
        """Whether a field of the model, or of its options ("opt.gravity"), can differ from world to world."""
        of, name = (mjw.Option, field[4:]) if field.startswith("opt.") else (mjw.Model, field)
        spec = next((one.type for one in dataclasses.fields(of) if one.name == name), None)
        return getattr(spec, "shape", ())[:1] == ("*",)

    def step(
        self, state: Array, fields: Mapping[str, np.ndarray], steps: int, record: Sequence[str], last: Sequence[str]
    ) -> tuple[Array, dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Step all worlds.

        Args:
            state: of the worlds (N, state), as in `mujoco.batch.Batch.state`.
            fields: model fields (N, ...) that differ from world to world.
            steps: number of physics steps, at least 1.
            record: names of the MjData fields to return after every step.
            last: names of those to return after the last step.

        Returns:
            states (N, state), the fields in `record`, (steps, N, ...) each, and those in `last`, (N, ...) each.

        Raises:
            TrackslipError: if there was no room for all contacts.
        """
        with wp.ScopedDevice(self._device):
            self._state.assign(state)
            for name, values in fields.items():
                self._put(name, values)
            self._data.overflow.zero_()
            sources = {name: getattr(self._data, name) for name in record}
            records = {name: wp.empty((steps, *of.shape), dtype=of.dtype) for name, of in sources.items()}
            load, advance, fetch = self._stages
            load()
            for k in range(steps):
                advance()
                for name, values in records.items():
                    wp.copy(values[k], sources[name])
            fetch()
            self._require_room()
            return (
                self._state.numpy(),
                {name: _flat(records[name], 2) for name in record},
                {name: _flat(getattr(self._data, name), 1) for name in last},
            )

    def _put(self, field: str, values: np.ndarray) -> None:
        """Write a model field (N, ...)."""
        of, name = (self._model.opt, field[4:]) if field.startswith("opt.") else (self._model, field)
        if field not in self._buffers:
            shared = getattr(of, name)
            setattr(of, name, wp.zeros((self._size, *shared.shape[1:]), dtype=shared.dtype))
            self._buffers[field] = np.empty(values.shape, np.float32)
            self._stages = self._new_stages()  # graphs would read the field that all worlds shared
        np.copyto(self._buffers[field], values, casting="same_kind")
        array = getattr(of, name)
        array.assign(self._buffers[field].reshape(*array.shape, *getattr(array.dtype, "_shape_", ())))

    def _new_stages(self) -> tuple[Replayed, ...]:
        return Replayed(self._load), Replayed(self._advance), Replayed(self._fetch)

    def _load(self) -> None:
        """Hand the state to MuJoCo Warp."""
        wp.launch(round_state, dim=self._state.shape, inputs=[self._state], outputs=[self._rounded])
        mjw.set_state(self._model, self._data, self._rounded, _SIGNATURE)

    def _advance(self) -> None:
        """Let a physics step pass."""
        data = self._data
        mjw.step(self._model, data)
        outputs = [self._state, data.qpos]
        wp.launch(integrate_pose, dim=self._size, inputs=[self._timestep, data.qvel], outputs=outputs)

    def _fetch(self) -> None:
        """Take the state back."""
        mjw.get_state(self._model, self._data, self._rounded, _SIGNATURE)
        wp.launch(widen_state, dim=self._state.shape, inputs=[self._rounded], outputs=[self._state])

    def _require_room(self) -> None:
        overflow = self._data.overflow.numpy() & ~int(_SLOW)
        if overflow.any():
            which = np.flatnonzero(overflow)
            what = mjw.OverflowType(int(overflow[which[0]])).name
            raise TrackslipError(f"MuJoCo Warp has no room for all contacts of robot {which[0]} ({what})")


def _room(model: mujoco.MjModel) -> tuple[int, int]:
    """Number of contacts and of constraints to make room for."""
    on_plane = model.geom_type[model.pair_geom1] == mujoco.mjtGeom.mjGEOM_PLANE
    kinds = (mujoco.mjtGeom(kind) for kind in model.geom_type[model.pair_geom2])
    points = np.where(on_plane, [_POINTS.get(kind, _MOST_POINTS) for kind in kinds], _MOST_POINTS)
    pyramids = model.opt.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL
    per_point = np.maximum(2 * (model.pair_dim - 1), 1) if pyramids else model.pair_dim
    unpaired = _UNPAIRED if (model.geom_contype | model.geom_conaffinity).any() else 0
    most = 10 if pyramids else 6  # of a contact with friction of all kinds
    others = 6 * model.neq + model.nv + model.njnt + 2 * model.ntendon  # equalities, dry friction, limits
    return int(points.sum()) + unpaired, int(np.dot(points, per_point)) + most * unpaired + others


def _flat(array: wp.array, axes: int) -> np.ndarray:
    """On the host, with `axes` axes before those of the field, matrices as rows."""
    values: np.ndarray = array.numpy()
    matrix = len(getattr(array.dtype, "_shape_", ())) == 2
    return values.reshape(*values.shape[:-2], -1) if matrix else values
