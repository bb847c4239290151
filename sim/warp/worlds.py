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

from trackslip.errors import TrackslipError, require
from trackslip.kinematics import Array

_INTEGRATORS = (mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
_POSE = 7  # numbers in the pose of a free joint: position, quaternion
_QPOS = 1  # where positions begin in a state, after the time
_CONTACTS = 4  # most points of contact between a pair of geoms, e.g. of a box on the ground
_ROWS = 6  # most constraints per contact
_SLOW = mjw.OverflowType.ITERATIONS | mjw.OverflowType.LS_ITERATIONS  # a solver that stops early lost no contact
_SIGNATURE = int(mujoco.mjtState.mjSTATE_INTEGRATION)


@wp.kernel(enable_backward=False)
def _round(state: wp.array2d[wp.float64], rounded: wp.array2d[wp.float32]):  # type: ignore[no-untyped-def]
    world, k = wp.tid()
    rounded[world, k] = wp.float32(state[world, k])


@wp.kernel(enable_backward=False)
def _integrate(  # type: ignore[no-untyped-def]
    step: wp.float64, qvel: wp.array2d[wp.float32], state: wp.array2d[wp.float64], qpos: wp.array2d[wp.float32]
):
    """Let a physics step of the robot's free joint pass; the engine does the same in single precision."""
    world = wp.tid()
    state[world, 0] = state[world, 0] + step
    for k in range(3):
        place = state[world, _QPOS + k] + step * wp.float64(qvel[world, k])
        state[world, _QPOS + k] = place
        qpos[world, k] = wp.float32(place)
    spin = wp.vec3d(wp.float64(qvel[world, 3]), wp.float64(qvel[world, 4]), wp.float64(qvel[world, 5]))  # in its frame
    first = _QPOS + 3
    rotation = wp.quatd(state[world, first + 1], state[world, first + 2], state[world, first + 3], state[world, first])
    rate = wp.length(spin)
    if rate > wp.float64(0.0):
        rotation = wp.normalize(rotation * wp.quat_from_axis_angle(spin / rate, rate * step))
    # Warp's quaternions end with the real part, MuJoCo's begin with it
    for k in range(4):
        state[world, first + k] = rotation[(k + 3) % 4]
        qpos[world, 3 + k] = wp.float32(rotation[(k + 3) % 4])


@wp.kernel(enable_backward=False)
def _widen(rounded: wp.array2d[wp.float32], state: wp.array2d[wp.float64]):  # type: ignore[no-untyped-def]
    world, k = wp.tid()
    if k >= _QPOS + _POSE:
        state[world, k] = wp.float64(rounded[world, k])


class Worlds:
    """N worlds on a device of Warp."""

    def __init__(self, model: mujoco.MjModel, size: int, device: str) -> None:
        """`size` worlds of a model on a `device` of Warp, "cuda" or "cpu".

        Raises:
            InvalidValueError: for a model whose pose isn't that of a free joint, or an integrator of higher order.
            TrackslipError: for a model with parts that MuJoCo Warp doesn't have.
        """
        free = model.njnt > 0 and model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
        require(free, "model", "its first joint", "a free joint, to run on MuJoCo Warp")
        integrator = mujoco.mjtIntegrator(model.opt.integrator)
        allowed = "Euler or implicitfast, to run on MuJoCo Warp"
        require(integrator in _INTEGRATORS, "option.integrator", integrator.name.removeprefix("mjINT_"), allowed)
        wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)  # else it reports every kernel it compiles
        self._device = wp.get_device(device)
        self._size, self._timestep = size, float(model.opt.timestep)
        contacts = max(_CONTACTS * model.npair, _CONTACTS)
        rows = _ROWS * (contacts + model.neq) + 2 * model.nv + model.njnt + model.ntendon
        with wp.ScopedDevice(self._device):
            try:
                self._model = mjw.put_model(model)
            except NotImplementedError as error:
                raise TrackslipError(f"MuJoCo Warp can't step this model: {error}") from error
            # it would accept residuals that tilt a robot at rest by 0.02 mrad
            self._model.opt.tolerance.fill_(model.opt.tolerance)
            self._model.opt.warn_overflow = 0  # `_require_room` does
            self._data = mjw.make_data(model, nworld=size, nconmax=contacts, njmax=rows)
            width = mujoco.mj_stateSize(model, _SIGNATURE)
            self._state = wp.zeros((size, width), dtype=wp.float64)
            self._rounded = wp.zeros((size, width), dtype=wp.float32)
        self._buffers: dict[str, np.ndarray] = {}
        self._graphs: dict[tuple[int, tuple[str, ...]], tuple[dict[str, wp.array], wp.Graph | None]] = {}

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
            records = self._advance(steps, tuple(record))
            self._require_room()
            moved = self._state.numpy()
            return (
                moved,
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
            self._graphs.clear()  # they would read the field that all worlds shared
        np.copyto(self._buffers[field], values, casting="same_kind")
        array = getattr(of, name)
        array.assign(self._buffers[field].reshape(*array.shape, *getattr(array.dtype, "_shape_", ())))

    def _advance(self, steps: int, record: tuple[str, ...]) -> dict[str, wp.array]:
        """Step all worlds and return what is recorded, (steps, N, ...) each, which the next call overwrites."""
        key = steps, record
        if key not in self._graphs:
            sources = {name: getattr(self._data, name) for name in record}
            records = {name: wp.empty((steps, *of.shape), dtype=of.dtype) for name, of in sources.items()}
            self._launch(steps, records)  # compiles what a graph needs compiled
            self._graphs[key] = records, None
        elif self._device.is_cuda:
            records, graph = self._graphs[key]
            if graph is None:
                with wp.ScopedCapture() as capture:
                    self._launch(steps, records)
                self._graphs[key] = records, (graph := capture.graph)
            wp.capture_launch(graph)
        else:
            self._launch(steps, self._graphs[key][0])
        return self._graphs[key][0]

    def _launch(self, steps: int, records: Mapping[str, wp.array]) -> None:
        model, data, state = self._model, self._data, self._state
        wp.launch(_round, dim=state.shape, inputs=[state], outputs=[self._rounded])
        mjw.set_state(model, data, self._rounded, _SIGNATURE)
        for k in range(steps):
            mjw.step(model, data)
            wp.launch(_integrate, dim=self._size, inputs=[self._timestep, data.qvel], outputs=[state, data.qpos])
            for name, values in records.items():
                wp.copy(values[k], getattr(data, name))
        mjw.get_state(model, data, self._rounded, _SIGNATURE)
        wp.launch(_widen, dim=state.shape, inputs=[self._rounded], outputs=[state])

    def _require_room(self) -> None:
        overflow = self._data.overflow.numpy() & ~int(_SLOW)
        if overflow.any():
            which = np.flatnonzero(overflow)
            what = mjw.OverflowType(int(overflow[which[0]])).name
            raise TrackslipError(f"MuJoCo Warp has no room for all contacts of robot {which[0]} ({what})")


def _flat(array: wp.array, axes: int) -> np.ndarray:
    """On the host, with `axes` axes before those of the field, matrices as rows."""
    values: np.ndarray = array.numpy()
    matrix = len(getattr(array.dtype, "_shape_", ())) == 2
    return values.reshape(*values.shape[:-2], -1) if matrix else values
