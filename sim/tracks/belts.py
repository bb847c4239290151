"""Belts in a compiled model or a batch of simulations: their speeds, motors, steps and readings."""

from __future__ import annotations

from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.motors.belt_motors import BeltMotors, MotorReading
from sim.motors.motor import TorqueLaw
from sim.tracks.description import moving_mass, set_contacts, tracks_in
from sim.tracks.reading import SENSED_WIDTH, Reading, read_contacts
from trackslip.errors import require

_ONE = np.zeros(1, int)  # row of the only simulation, where there is no batch
_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)

Floats = NDArray[np.float64]


STANDS: Final = -1
"""Motor of a belt that never turns, such as a skid's."""


class _Map:
    """Where the belts of T tracks with G geoms are in a compiled model."""

    def __init__(self, model: mujoco.MjModel) -> None:
        every = tracks_in(model)
        require(every, "model", "no tracks in it", "one with tracks: add_tracks adds them")
        for tracks in every:
            set_contacts(model, tracks)
        self.names = tuple(name for tracks in every for name in tracks.names)
        self.hulls = [tracks.hull for tracks in every for _ in tracks.names]
        self.bodies = np.concatenate([tracks.bodies for tracks in every])  # (T,)
        self.geoms = np.concatenate([tracks.geoms for tracks in every])  # (G,)
        # (G, 6) surface velocities at a belt speed of 1 m/s
        self.direction = np.concatenate([tracks.direction for tracks in every])
        counts = [len(tracks.names) for tracks in every]
        before = np.cumsum(counts) - counts
        # (G,) index of each geom's track
        self.track = np.concatenate(
            [tracks.track + start for tracks, start in zip(every, before, strict=True)]
        )

        # a geom of each track, from whose surface velocity the belt's speed is read
        first = np.searchsorted(self.track, np.arange(len(self.names)))
        self.leader = self.geoms[first]
        leading = self.direction[first]
        self.lead = leading / (leading**2).sum(axis=-1, keepdims=True)

        # what the search for a motor's speed needs: forces, and how they change with the speed
        mass = moving_mass(model, self.bodies).max()
        self.weight = mass * (float(np.linalg.norm(model.opt.gravity)) or 9.81)
        self.slope = mass * max(tracks.preset.grip for tracks in every)
        self.radius = np.array([hull.wheels[:, 2].max() for hull in self.hulls])

        # the places of each track's contacts (T,) in the sensor data
        sensors = [model.sensor(model.body(body).name).id for body in self.bodies]
        self.first = model.sensor_adr[sensors]
        self.slots = model.sensor_dim[sensors] // SENSED_WIDTH

    def motors(
        self,
        size: int,
        motor: NDArray[np.int_],
        law: TorqueLaw | None = None,
        sprocket_radius: ArrayLike | None = None,
    ) -> BeltMotors:
        """Motors for `size` simulations; `motor` (T,) is the index of each track's motor, `law` the
        limits and losses of all motors, and `sprocket_radius`, by default the largest wheel's, a
        scalar or one for each motor (M,) [m].
        """
        count = int(motor.max()) + 1
        if sprocket_radius is None:
            radius = np.array([self.radius[motor == each].max() for each in range(count)])
        else:
            radius = np.broadcast_to(np.asarray(sprocket_radius, float), count).copy()
        return BeltMotors(size, radius, self.weight, self.slope, law)

    def surface(self, speeds: Floats) -> Floats:
        """Surface velocities (..., G, 6) of the tracks' geoms at belt speeds (..., T)."""
        return speeds[..., self.track, None] * self.direction

    def speeds(self, surface: Floats) -> Floats:
        """Belt speeds (..., T) from surface velocities (..., ngeom, 6); the inverse of
        `surface`.
        """
        speeds: Floats = (surface[..., self.leader, :] * self.lead).sum(axis=-1)
        return speeds

    def read(self, sensordata: Floats, xmat: Floats, speeds: Floats) -> Reading:
        """Reading for sensor data (..., S), rotations (..., nbody, 9) of all bodies and belt speeds
        (..., T).
        """
        found = sensordata[..., self.first].astype(int)
        reported = np.minimum(found, self.slots)  # a sensor fills its slots from the first on
        counts = reported.ravel()

        # (C,) index of each contact's track, and of its slot in the track's sensor
        owner = np.repeat(np.arange(found.size), counts)
        before = np.cumsum(counts) - counts
        slot = np.arange(len(owner)) - np.repeat(before, counts)

        state, track = np.divmod(owner, len(self.names))
        start = state * sensordata.shape[-1] + self.first[track] + slot * SENSED_WIDTH
        sensed = np.take(sensordata, start + np.arange(SENSED_WIDTH)[:, None])
        lateral = xmat[..., self.bodies, 1::3]
        return read_contacts(sensed, owner, found - reported, lateral, speeds)


class Belts:
    """The belts of T tracks in a compiled model, whether it was built in Python or loaded from a
    file.
    """

    names: tuple[str, ...]
    """Name of each track (T,)."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Find the model's tracks, in the order in which they were added, and set their contact
        parameters.

        These parameters depend on the robot's total mass.

        Raises InvalidValueError for a model without tracks, and for contacts that can't follow
        their recipe.
        """
        self._model, self._map = model, _Map(model)
        self.names = self._map.names
        self._motors = self._map.motors(1, np.arange(len(self.names)))
        self.hulls = self._map.hulls
        """Hull of each track."""
        self.bodies = self._map.bodies
        """Body of each track (T,), at its middle."""
        # else the engine would ignore later speeds, as belts are compiled at rest
        model.flg_surfacevel = 1

    def set(
        self, speeds: ArrayLike, torque_limit: ArrayLike | None = None, inertia: ArrayLike = 0.0
    ) -> None:
        """Set the belt speeds (T,) [m/s], positive forwards.

        With a torque limit, these speeds are set points, from which `step` finds the actual speeds.

        Args:
            speeds: belt speeds (T,) [m/s].
            torque_limit: largest torque of each belt's motor at its sprocket (the largest wheel of
                the hull), a scalar or (T,) [N m]; by default the belts reach their speeds at once.
            inertia: moment of inertia of motor, gear and belt at the sprocket, a scalar or (T,) [kg
                m^2].

        Raises:
            InvalidValueError: for speeds that aren't finite, negative limits or inertias, and wrong
                shapes.
        """
        self._motors.set(_ONE, _speeds(speeds, len(self.names)), torque_limit, inertia)
        self._put(self._motors.speed[0])

    def step(self, data: mujoco.MjData) -> None:
        """Advance by one physics step with the motors that `set` chose; replaces `mujoco.mj_step`.

        The step is repeated from the same state until the belt speeds are in balance with the
        motors and the ground.
        """
        model = self._model
        state = np.empty(mujoco.mj_stateSize(model, _STATE))
        mujoco.mj_getState(model, data, state, _STATE)

        def attempt(_: NDArray[np.int_], speeds: Floats) -> Floats:
            mujoco.mj_setState(model, data, state, _STATE)
            self._put(speeds[0])
            mujoco.mj_step(model, data)
            return self.read(data).traction[None]

        self._motors.advance(_ONE, model.opt.timestep, attempt)

    def motors(self) -> MotorReading:
        """Torque, speed, power and energy (T,) of the motors after the last `step`."""
        return self._motors.read(0)

    def _put(self, speeds: Floats) -> None:
        self._model.geom_surfacevel[self._map.geoms] = self._map.surface(speeds)

    def speeds(self) -> Floats:
        """Belt speeds (T,) [m/s]."""
        return self._map.speeds(self._model.geom_surfacevel)

    def read(self, data: mujoco.MjData) -> Reading:
        """Forces and motion (T,) of the tracks in the last step, for the belts' current speeds."""
        return self._map.read(data.sensordata, data.xmat, self.speeds()).complete(self.names)

    def bind_batch(
        self,
        batch: Any,
        motor: ArrayLike | None = None,
        law: TorqueLaw | None = None,
        sprocket_radius: ArrayLike | None = None,
    ) -> BatchBelts:
        """Return the belts of the model in a `mujoco.batch.Batch` of simulations.

        `motor` is the index of each belt's motor (T,), from 0; by default each belt has its own
        motor. Belts with the same motor, such as those on one side of a robot with flippers, share
        speed and torque; those with the motor -1, such as skids, stand still. `law` are the
        torque-speed line and the losses of all motors, such as a `sim.motors.motor.Motor`; by
        default the torque limit holds at any speed, without losses. `sprocket_radius` is a scalar
        or one for each motor (M,), by default the radius of the largest wheel [m].
        """
        own = np.arange(len(self.names))
        index = own if motor is None else np.asarray(motor, int)
        return BatchBelts(self._map, batch, index, law, sprocket_radius)


class BatchBelts:
    """The belts of T tracks in each of N simulations of a batch."""

    names: tuple[str, ...]
    """Name of each track (T,)."""

    def __init__(
        self,
        where: _Map,
        batch: Any,
        motor: NDArray[np.int_],
        law: TorqueLaw | None,
        sprocket_radius: ArrayLike | None,
    ) -> None:
        """Use `Belts.bind_batch`, which explains the arguments."""
        self._map = where
        self.names = where.names
        self._batch = batch
        self._motor = motor
        self._turns = motor != STANDS
        self._motors = where.motors(batch.nsim, motor, law, sprocket_radius)
        # (N, ngeom, 6), a view of the batch
        self._surface: NDArray[np.float64] = batch.expand("geom_surfacevel")
        # (N, S), a view of the batch
        self._sensordata: NDArray[np.float64] = batch.bind("sensordata")
        self._xmat: NDArray[np.float64] = batch.bind("xmat")  # (N, nbody, 9), a view of the batch

    def set(
        self,
        speeds: ArrayLike,
        rows: Any = slice(None),
        torque_limit: ArrayLike | None = None,
        inertia: ArrayLike = 0.0,
    ) -> None:
        """Set the belt speeds (R, M) of M motors [m/s]; limits and inertias, (M,) or (R, M), as in
        `Belts.set`.
        """
        where = np.arange(len(self._surface))[rows]
        self._motors.set(where, _speeds(speeds, self._motors.speed.shape[1]), torque_limit, inertia)
        self._put(where, self._motors.speed[where])

    def get_state(self) -> tuple[Floats, Floats]:
        """Return a copy of all motors' states; belt speeds are part of the batch's own state."""
        return self._motors.get_state()

    def set_state(self, state: tuple[Floats, Floats]) -> None:
        """Restore a state from `get_state`, of these belts or of belts bound to an equal batch."""
        self._motors.set_state(state)

    def begin(self, rows: Any = slice(None)) -> None:
        """Stop the belts in the simulations `rows` and remove the limits of their motors, before a
        new run.
        """
        where = np.arange(len(self._surface))[rows]
        self._motors.begin(where)
        self._put(where, self._motors.speed[where])

    def step(self, rows: Any = slice(None)) -> Reading:
        """Advance the simulations `rows` (R,) by one physics step with the motors that `set` chose;
        see `Belts.step`.

        Returns forces and motion (R, T), in which contacts may be missing: see `Reading.complete`.
        """
        where = np.arange(len(self._surface))[rows]
        state, readings = self._batch.state.copy(), []

        def attempt(tried: NDArray[np.int_], speeds: Floats) -> Floats:
            self._batch.state[tried] = state[tried]
            self._put(tried, speeds)
            self._batch.step(ids=tried)
            reading = self._read(tried)
            readings.append((tried, reading))
            return self._by_motor(reading.traction)

        self._motors.advance(where, float(self._batch.model.opt.timestep), attempt)
        (_, last), *again = readings  # the first attempt includes all simulations
        for tried, reading in again:
            last.put(np.searchsorted(where, tried), reading)
        return last

    def motors(self) -> MotorReading:
        """Torque, speed, power and energy (N, M) of the motors after the last `step`."""
        return self._motors.read()

    def _put(self, rows: NDArray[np.int_], speeds: Floats) -> None:
        """Set the belt speeds (R, M) of the motors in simulations `rows` (R,)."""
        self._surface[rows[:, None], self._map.geoms] = self._map.surface(self._by_belt(speeds))

    def _by_belt(self, speeds: Floats) -> Floats:
        """Speeds (..., T) of the belts at speeds (..., M) of their motors [m/s]."""
        return np.where(self._turns, speeds[..., self._motor], 0.0)

    def _by_motor(self, traction: Floats) -> Floats:
        """Sum the belts' tractions (..., T) for each motor, to (..., M)."""
        motors = range(self._motor.max() + 1)
        sums = [traction[..., self._motor == each].sum(axis=-1) for each in motors]
        return np.stack(sums, axis=-1)

    def speeds(self) -> Floats:
        """Belt speeds (N, T) [m/s]."""
        return self._map.speeds(self._surface)

    def read(self) -> Reading:
        """Forces and motion (N, T) of the tracks in the last step, for the belts' current
        speeds.
        """
        return self._read(slice(None)).complete(self.names)

    def run(self, steps: int, rows: Any = slice(None)) -> Reading:
        """Advance the simulations `rows` by several physics steps with the speeds or motors that
        `set` chose.

        Returns forces and motion (R, steps, T) in each step, in which contacts may be missing: see
        `Reading.complete`. A simulation that diverges stops, and the reading of its last step is
        repeated.
        """
        where = np.arange(len(self._surface))[rows]
        before, goal = self._batch.state[where], self._motors.goal(where)
        self._put(where, goal)
        recorded = self._batch.rollout(steps, record=("sensordata", "xmat"), ids=where)
        speeds = np.repeat(self._by_belt(goal)[:, None], steps, axis=1)
        reading = self._map.read(recorded["sensordata"], recorded["xmat"], speeds)
        if self._motors.limited(where):
            traction = self._by_motor(reading.traction)
            weak = ~self._motors.hold(where, float(self._batch.model.opt.timestep), traction)
            if weak.any():
                self._batch.state[where[weak]] = before[weak]
                for k in range(steps):
                    reading.put((weak, k), self.step(where[weak]))
        else:
            self._motors.roll(where, steps * float(self._batch.model.opt.timestep))
        return reading

    def _read(self, rows: Any) -> Reading:
        speeds = self._map.speeds(self._surface[rows])
        return self._map.read(self._sensordata[rows], self._xmat[rows], speeds)


def _speeds(speeds: ArrayLike, count: int) -> Floats:
    values = np.asarray(speeds, float)
    fits = values.ndim > 0 and values.shape[-1] == count
    require(fits, "shape of speeds", values.shape, f"(..., {count}), a belt each")
    require(
        np.isfinite(values).all(), "speeds", values[~np.isfinite(values)][:1].tolist(), "finite"
    )
    return values
