"""A fleet: N driven robots, each in its own world, simulated together with mujoco.batch."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.engine.simulations import Simulations, steps_in
from sim.fleet.ground import EVERYONE, FleetGround, Rows, one_each, require_at_rest
from sim.ground.ground import Ground
from sim.ground.pull import Pull
from sim.ground.ruts import Ruts
from sim.ground.shear import Shear
from sim.ground.wheel_ruts import WheelRuts
from sim.motors.motor import Drive, or_tireless
from sim.motors.sprockets import Forecast, Sprockets
from sim.robot.parameters import MAX_RADIUS_ERROR, SINK
from sim.robot.robot import Robot
from trackslip import se2
from trackslip.arguments import checks_arguments
from trackslip.errors import require
from trackslip.kinematics import Array

SETTLING: Final = 1.0
"""Time for which robots settle before a fleet's first period [s]."""
_RESETTLING: Final = 0.4  # for robots that are placed at their sinkage [s]
_TURN: Final = 2 * np.pi
_ROUNDING: Final = 1e-9  # tolerance on times [s]


@checks_arguments
class Fleet(Simulations):
    """N robots on their grounds. Results are bitwise identical for equal arguments and any number
    of threads.
    """

    STATE = (
        "_heading",
        "_radius",
        "_began",
        "_periods",
        "drive",
        "_ground",
        "sensed",
        "mean_traction",
    )

    def __init__(
        self,
        robot: Robot,
        start: ArrayLike,
        ground: Ground | Sequence[Ground] | None = None,
        radius_error: ArrayLike | None = None,
        drive: Drive | None = None,
        threads: int = 0,
        pull: Pull | None = None,
        shears: bool = False,
        sinks: bool = False,
    ) -> None:
        """Place N robots at rest at poses `start` (N, 3) [m, m, rad].

        `ground` is a ground for all robots, or one per robot; `radius_error`, the sprockets'
        relative error, is a scalar or (N,), by default the robot's [-]. All sprockets have the same
        `drive`, by default the robot's; the torque of a robot without one is unlimited. All robots
        tow the same `pull`. `threads` is the number of worker threads, 0
        for one per processor. If a ground shears, or if `shears` announces that a later one may,
        pads touch the ground at one point each instead of two. If a ground is soft, or if `sinks`
        announces that a later one may be, robots leave ruts.

        Raises:
            InvalidValueError: for poses that aren't finite, a wrong number of grounds, a slope on
                which robots would slide or tip over, a pull that drags robots backwards, or a servo
                period that is not a multiple of the physics step.
        """
        start = np.atleast_2d(np.asarray(start, float))
        are_poses = start.ndim == 2 and start.shape[1] == 3
        valid = are_poses and np.isfinite(start).all()
        require(valid, "start", start.tolist(), "N finite poses (x, y, phi)")
        grounds = one_each(ground or Ground(), len(start))
        sinks = sinks or any(each.soil is not None for each in grounds)
        shears = shears or sinks or any(each.largest_shear > 0 for each in grounds)
        if shears:
            robot = robot.with_single_contacts()
        if sinks:
            robot = robot.with_movable_ground()
        super().__init__(robot.model, len(start), threads)
        self.robot = robot

        # views of the batch
        # (N, 6) view: forces on the left and right tracks
        self._sensors = self.batch.bind("sensordata")[:, :6]
        self._chassis = robot.model.body("chassis").id
        # (N, 2) view: x axes of the chassis
        self._forward = self.batch.bind("xmat")[:, self._chassis, 0:4:3]
        self.plate = self.batch.bind("geom_xpos")[:, robot.model.geom("plate").id]
        """Centres (N, 3) of the robots' plates one physics step ago, a view of the batch [m]."""
        surface = self.batch.expand("geom_surfacevel")  # (N, ngeom, 6)
        self.belts = surface[:, robot.pads, 2]
        """Speed of each pad's surface along the pad's own axis (N, P), a view of the batch
        [m/s].
        """
        self._slanted = surface[:, robot.pads, 0]  # (N, P) view: surface speed across a tilted pad
        self._wrench = self.batch.bind("xfrc_applied")[:, self._chassis]  # (N, 6) view

        self._heading: Array = np.zeros(self.size)  # (N,) unwrapped [rad]
        self._split = robot.parameters.radius_split * np.array([-1.0, 1.0])
        error = robot.parameters.radius_error if radius_error is None else radius_error
        self._radius = self._effective_radius(np.broadcast_to(error, (self.size,)))
        drive = or_tireless(drive or robot.parameters.drive)
        self.drive = Sprockets(drive, self.size, robot.geometry.sprocket_radius, self._radius)
        """Sprockets of the robots, with their motors and servos."""
        self.period = drive.period
        """Period of the servos [s]."""
        self._substeps = steps_in(
            "drive.period", drive.period, "the physics step", robot.model.opt.timestep
        )

        self.shear = _new_shear(robot, self.size, drive) if shears else None
        """Shear of the ground under the robots; None for fleets that stay on Coulomb ground."""
        self.ruts = _new_ruts(robot, self.size, drive) if sinks else None
        """Ruts of the robots in soft soil; None for fleets that stay on firm ground."""
        self._ground = FleetGround(self.batch, robot, grounds, self.shear, self.ruts)
        self.sensed: Array = np.zeros((self.size, robot.model.nsensordata))
        """Means of the engine's sensor data (N, S) over the last `advance`."""
        self.mean_traction: Array = np.zeros((self.size, 2))
        """Mean longitudinal forces of the ground on the (left, right) tracks (N, 2) over the last
        `advance` [N].
        """
        self.pull = pull or Pull()
        """Pull on each of the robots."""

        self._periods = 0  # number of periods simulated so far
        # (N,) period in which each robot's run began
        self._began: NDArray[np.int_] = np.zeros(self.size, int)
        self._begin(np.arange(self.size), start, 0.0, SETTLING)

    def pose(self) -> Array:
        """True poses (N, 3) of the chassis, with unwrapped headings [m, m, rad]."""
        pose = np.empty((self.size, 3))
        pose[:, :2] = self.state.qpos[:, :2]
        pose[:, 2] = self._heading
        return pose

    def twist(self) -> Array:
        """True twists (N, 3): forward speed, lateral speed to the left [m/s], yaw rate [rad/s]."""
        twist = np.empty((self.size, 3))
        twist[:, :2] = se2.rotate(-self._heading, self.state.qvel[:, :2])
        twist[:, 2] = self.state.qvel[:, 5]
        return twist

    def load(self) -> Array:
        """Normal forces (N, 2) of the ground on the (left, right) tracks in the last physics step
        [N].
        """
        return self._sensors[:, 2::3].copy()

    def attitude(self) -> Array:
        """Sinkage, positive downwards [m], roll to the right and pitch forwards [rad] of the
        chassis, (N, 3).
        """
        return np.stack([-self.state.position[:, 2], self.state.roll, -self.state.pitch], axis=-1)

    @property
    def ground(self) -> tuple[Ground, ...]:
        """The ground under each robot."""
        return self._ground.grounds

    def restart(self, rows: ArrayLike, setups: Sequence[RunSetup]) -> None:
        """Begin new runs with the robots `rows` (R,), one setup each; the runs of other robots
        continue.

        Raises InvalidValueError for poses that aren't finite and for slopes too steep for parking.
        """
        rows = np.asarray(rows, int)
        if not rows.size:
            return
        order = np.argsort(rows)  # the engine takes them in ascending order
        rows = rows[order]
        setups = [setups[k] for k in order]
        start = np.array([setup.start for setup in setups], float)
        require(np.isfinite(start).all(), "start", start.tolist(), "finite poses (x, y, phi)")
        errors = []
        lags = []
        for setup in setups:
            own_error = self.robot.parameters.radius_error
            errors.append(own_error if setup.radius_error is None else setup.radius_error)
            lags.append(self.drive.drive.lag if setup.lag is None else setup.lag)
        self._radius[rows] = self._effective_radius(np.array(errors))
        self.drive.restart(rows, lags)
        self._began[rows] = self._periods

        mass = np.array([setup.mass for setup in setups])
        com_offset = np.array([setup.com_offset for setup in setups])
        self._set_belts(rows, 1.0)  # `_set_payload` needs moving belts
        self._set_payload(rows, self._chassis, mass, com_offset)
        self._set_belts(rows, 0.0)
        self._ground.put([setup.ground for setup in setups], rows)
        self._begin(rows, start, -SINK, _RESETTLING)

    def _effective_radius(self, error: Array) -> Array:
        """Effective sprocket radii (R, 2) of robots with radius errors (R,) [m]."""
        allowed = f"from {-MAX_RADIUS_ERROR:g} to {MAX_RADIUS_ERROR:g}"
        require((np.abs(error) <= MAX_RADIUS_ERROR).all(), "radius_error", error.tolist(), allowed)
        return np.asarray(self.robot.geometry.sprocket_radius * (1 + error[:, None] + self._split))

    def _set_belts(self, rows: Rows, belts: float | Array) -> None:
        """Set surface speeds, a scalar or (R, P), of the pads on the robots `rows` (R,) [m/s]."""
        self.belts[rows] = belts
        if self.shear is not None:  # a pad that touches at one point moves across its own axis, too
            self._slanted[rows] = belts * self.robot.pad_slant

    def set_ground(self, ground: Ground | Sequence[Ground]) -> None:
        """Replace the ground, by one for all robots or one per robot, with immediate effect, even
        during a run.
        """
        self._ground.put(one_each(ground, self.size))
        self._lay_friction(EVERYONE)
        self._ground.tilt(np.arange(self.size))

    def command(self, omega: ArrayLike) -> None:
        """Set the set points (N, 2) or (2,) of the sprockets, which hold until the next call
        [rad/s].
        """
        omega = np.asarray(omega, float)
        if omega.shape != (self.size, 2):  # np.broadcast_to is slow
            omega = np.broadcast_to(omega, (self.size, 2))
        self.drive.command(omega)

    def advance(self, duration: float) -> None:
        """Simulate `duration` [s]; raises InvalidValueError unless it is a multiple of the servo
        period.

        Servos compensate their loads, so the motion of the sprockets is known in advance if the
        motors are strong enough (`sim.motors.sprockets`). All robots are first simulated with this
        forecast. Those whose motors prove too weak go back and drive within the motors' limits.
        """
        periods = round(duration / self.period)
        is_multiple = abs(periods * self.period - duration) <= _ROUNDING
        allowed = f"0 or a multiple of the servo period, {self.period} s"
        require(is_multiple and periods >= 0, "duration", duration, allowed)
        if periods == 0:
            return

        # all robots move as their servos demand, which shows the torques that this takes
        before = self._snapshot(EVERYONE)
        forecast = self.drive.forecast(periods)
        traction = self._run(EVERYONE, forecast.mean)
        torque = self.drive.torque_for(forecast, traction)
        weak = self.drive.too_weak(forecast, torque)
        if not weak.size:
            self.drive.accept(forecast, torque)
            return

        # Weak robots go back and repeat all periods, of which each counts again. Their sprockets
        # are set aside first, because `accept` advances all.
        limited = self.drive.of(weak)
        self.drive.accept(forecast, torque)
        self._restore(weak, tuple(part[weak] for part in before))
        self._periods -= periods
        self._advance_within_limits(weak, limited, periods)
        self.drive.put(weak, limited)

    def launch(self, twist: ArrayLike) -> None:
        """Give the robots twists (N, 3) or (3,), without a change in sprocket speeds.

        A twist is the speed forwards and to the left [m/s], and the yaw rate [rad/s].
        """
        twist = np.broadcast_to(np.asarray(twist, float), (self.size, 3))
        require(np.isfinite(twist).all(), "twist", twist.tolist(), "finite")
        self.state.qvel[:, :2] = se2.rotate(self._heading, twist[:, :2])
        self.state.qvel[:, 5] = twist[:, 2]

    def follow(self, omega: Array) -> None:
        """Turn the sprockets at mean speeds (P, N, 2) in the next P servo periods, with unlimited
        torque [rad/s].
        """
        speeds = np.concatenate([self.drive.omega[None], omega])
        forecast = Forecast(speeds, omega, omega[-1] - self.drive.set_point)
        if self.ruts is not None:
            self.ruts.mark()
        traction = self._run(EVERYONE, omega)
        self.drive.accept(forecast, self.drive.torque_for(forecast, traction))

    def _run(self, rows: Rows, mean: Array) -> Array:
        """Drive `rows` (R,) for P periods at mean speeds (P, R, 2) [rad/s]; return mean tractions
        (P, R, 2) [N].
        """
        track_speeds = self._radius[rows] * mean
        belts = self.robot.pad_speeds(track_speeds)
        varies = self._ground.varies
        is_towed = self.pull.force > 0
        is_steady = not (mean != mean[0]).any()
        # the engine is faster without interruptions
        is_whole = is_steady and not varies and not is_towed and self.shear is None
        periods_at_once = len(mean) if is_whole else 1

        parts = []
        before = None if self.shear is None else self._places(rows)
        for k in range(0, len(mean), periods_at_once):
            if varies:
                self._lay_friction(rows)
            if is_towed or self.ruts is not None:
                self._tow(rows)
            self._set_belts(rows, belts[k])
            parts.append(self._roll(rows, periods_at_once))
            if self.ruts is not None:
                data, ahead = parts[-1]
                mean_force = np.add.reduce(data[..., :6], axis=1) / data.shape[1]
                self.ruts.traction[rows] = _along(mean_force, ahead[:, -1])
            if before is not None:
                after = self._places(rows)
                pose = None if self.ruts is None else self._stance(rows, after)
                self._ground.moved(rows, before, after, pose, track_speeds[k])
                before = after

        # an entry per servo period: sensor data of its steps, and the chassis' x axis, which the
        # engine computes at the beginning of the last step
        sensed = np.concatenate([data for data, _ in parts], axis=1)
        sensed = sensed.reshape(len(sensed), len(mean), self._substeps, -1)
        forward = np.concatenate([ahead for _, ahead in parts], axis=1).swapaxes(0, 1)
        self._unwrap(rows, np.arctan2(forward[..., 1], forward[..., 0]))

        # Grip builds up within a period, so only the mean force is consistent with the impulse. It
        # is taken along one heading, as a robot hardly turns in a period.
        mean_sensed = np.add.reduce(sensed, axis=2).swapaxes(0, 1) / self._substeps
        traction = _along(mean_sensed[..., :6], forward)
        self.sensed[rows] = mean_sensed.mean(axis=0)
        self.mean_traction[rows] = traction.mean(axis=0)
        return traction

    def _roll(self, rows: Rows, periods: int) -> tuple[Array, Array]:
        """Let the engine step the robots `rows` (R,) for P servo periods; return sensor data (R, S,
        n) of all S steps, and the chassis' x axes (R, P, 2) in the last step of each period.
        """
        ids = None if rows is EVERYONE else rows
        steps = periods * self._substeps
        recorded = self.batch.rollout(steps, record=("sensordata", "xmat"), ids=ids)
        self._periods += periods
        at_ends = slice(self._substeps - 1, None, self._substeps)
        forward = recorded["xmat"][:, at_ends, self._chassis, 0:4:3]
        return recorded["sensordata"], forward

    def _advance_within_limits(
        self, rows: NDArray[np.int_], drive: Sprockets, periods: int
    ) -> None:
        """Simulate some periods for the robots `rows` (R,), whose motors may be too weak to follow
        the servos.

        The sprocket of a weak motor ends a period at the speed for which its torque is just
        sufficient. The ground's response to a speed is found by trial steps.
        """
        gravity = float(np.linalg.norm(self.robot.model.opt.gravity))
        sensed = np.zeros_like(self.sensed[rows])
        traction = np.zeros_like(self.mean_traction[rows])
        for _ in range(periods):
            trial = functools.partial(self._repeat, rows, self._snapshot(rows), self._periods)
            # the nominal mass is enough, as it only scales tolerances and first guesses
            drive.advance_within_limits(self.robot.mass, gravity, trial)
            sensed += self.sensed[rows]
            traction += self.mean_traction[rows]
        self.sensed[rows] = sensed / periods
        self.mean_traction[rows] = traction / periods

    def _repeat(
        self,
        rows: NDArray[np.int_],
        before: tuple[Array, ...],
        began: int,
        which: NDArray[np.int_],
        omega: Array,
    ) -> Array:
        """Run the period that began in the state `before` of the robots `rows` (R,) again, with
        those at `which` (A,), at mean speeds (A, 2) [rad/s]; return mean tractions (A, 2) [N].
        """
        self._restore(rows[which], tuple(part[which] for part in before))
        self._periods = began
        return self._run(rows[which], omega[None])[0]

    def friction(self) -> Array:
        """Mean friction coefficients (N, 2) over the pads, along and across the tracks [-]."""
        return self._ground.friction.mean(axis=1)

    def _run_time(self) -> Array:
        """Times (N,) since the robots' runs began [s]."""
        return (self._periods - self._began) * self.period

    def _lay_friction(self, rows: Rows) -> None:
        """Update the friction of all pads on the robots `rows` (R,) for their current places and
        time.
        """
        self._ground.lay(rows, self._run_time(), self.state.qpos[:, :2], self.state.heading)

    def _tow(self, rows: Rows) -> None:
        """Apply the pull, and the resistance of soft soil, to the robots `rows` (R,), along their
        headings halfway through the next period.
        """
        heading = self.state.heading[rows] + self.state.qvel[rows, 5] * self.period / 2
        cos = np.cos(heading)
        sin = np.sin(heading)
        force = self._present_pull(rows)

        # moments of the pull at the hitch about the centre of mass
        centre = self._ground.centre_of_mass(rows)
        pitch = force * (centre[..., 2] - self.pull.height)
        yaw = -force * centre[..., 1]

        # and of the resistance at the bottom of each track, or at the axles of wheels
        if self.ruts is not None:
            left, right = self.ruts.resistance[rows].T
            half_gauge = self.robot.geometry.half_gauge
            force = force - (left + right)
            pitch = pitch - (left + right) * (centre[..., 2] - self.ruts.lever)
            pitch = pitch - self._ground.traction_moment(rows)
            yaw = yaw + (left + right) * centre[..., 1] + (right - left) * half_gauge
        wrench = np.zeros((len(heading), 6))
        wrench[:, 0] = -force * cos
        wrench[:, 1] = -force * sin
        wrench[:, 3] = -pitch * sin
        wrench[:, 4] = pitch * cos
        wrench[:, 5] = yaw
        self._wrench[rows] = wrench

    def _present_pull(self, rows: Rows) -> Array:
        """Pull (R,) on the robots `rows` (R,) at present [N]."""
        time = (self._periods - self._began[rows]) * self.period
        return self.pull.force * (time >= self.pull.since - _ROUNDING)

    def _snapshot(self, rows: Rows) -> tuple[Array, ...]:
        if self.ruts is not None:
            self.ruts.mark()
        return tuple(part[rows].copy() for part in self._parts())

    def _restore(self, rows: np.ndarray, snapshot: tuple[Array, ...]) -> None:
        for part, values in zip(self._parts(), snapshot, strict=True):
            part[rows] = values
        if self.ruts is not None:
            self.ruts.undo(rows)
            self._ground.press(rows, self._stance(rows))
        self._ground.share(rows)

    def _parts(self) -> tuple[Array, ...]:
        """The arrays that a servo period changes, without those of the drive; robots are on their
        first axis.
        """
        sheared = () if self.shear is None else self.shear.by_robot
        pressed = () if self.ruts is None else self.ruts.by_robot
        return self.batch.state, self._heading, *sheared, *pressed

    def _unwrap(self, rows: Rows, passed: Array) -> None:
        """Unwrap the headings of the robots `rows` (R,), whose values since the last call were
        `passed` (P, R).
        """
        heading = self.state.heading[rows]
        headings = np.concatenate([self._heading[None, rows], passed, heading[None]])
        turns = np.rint((headings[:-1] - headings[1:]) / _TURN)  # of the jumps between neighbours
        self._heading[rows] = heading + _TURN * np.add.reduce(turns)

    def _places(self, rows: Rows) -> Array:
        """Positions x and y [m], and cosines and sines of the headings, (4, R), of the robots
        `rows` (R,).
        """
        w, x, y, z = self.state.quaternion.T
        place = np.empty((4, self.size))
        place[:2] = self.state.qpos[:, :2].T
        place[2] = 1 - 2 * (y * y + z * z)  # neglects the lean, whose square is tiny
        place[3] = 2 * (w * z + x * y)
        return place[:, rows]

    def _stance(self, rows: Rows, place: Array | None = None) -> Array:
        """Poses (R, 7) of the robots `rows` (R,) in soil, see `Ruts.press`; `place` as from
        `_places`, if it is known.
        """
        _, _, cos, sin = self._places(rows) if place is None else place
        state = self.state
        w, x, y, z = state.quaternion[rows].T
        stance = np.empty((len(w), 7))
        stance[:, :3] = state.position[rows]
        stance[:, 3] = 2 * (x * z - w * y)
        stance[:, 4] = 2 * (y * z + w * x)
        stance[:, 5] = 1 - 2 * (x * x + y * y)
        stance[:, 6] = np.arctan2(sin, cos)
        return stance

    def _settle(self, rows: np.ndarray, duration: float) -> None:
        """Let the robots `rows` (R,) settle for a time [s], in soft soil period by period."""
        steps = round(duration / self.robot.model.opt.timestep)
        if self.ruts is None:
            self.batch.step(ids=rows, nstep=steps)
            return
        for done in range(0, steps, self._substeps):
            self.batch.step(ids=rows, nstep=min(self._substeps, steps - done))
            self._ground.press(rows, self._stance(rows))

    def _begin(self, rows: np.ndarray, start: Array, height: float, settling: float) -> None:
        """Place the robots `rows` (R,), at rest, at poses `start` (R, 3).

        Their frames start at a `height` [m], from which they settle for a time `settling` [s].
        Raises InvalidValueError if a robot doesn't stay at rest.
        """
        sinkage = self._ground.sinkage(rows)
        # robots in soft soil start where soil and contacts bear their weight
        in_soil = -SINK - sinkage
        self._place_at(rows, start, np.where(sinkage > 0, in_soil, height))
        self._ground.begin_ruts(rows, self._stance(rows))
        if self.shear is not None:
            self.shear.forget(rows)
        self._lay_friction(rows)
        self._ground.tilt(rows)
        grounds = [self.ground[k] for k in rows]
        heading = start[:, 2]
        self._tow(rows)
        self._settle(rows, settling)
        speed = np.hypot(*self.state.qvel[rows, :2].T)
        lean = np.abs(self.attitude()[rows, 1:]).max(axis=1)
        require_at_rest(grounds, heading, speed, lean, self.pull)
        self.sensed[rows] = self.batch.bind("sensordata")[rows]
        self.mean_traction[rows] = _along(self._sensors[rows], self._forward[rows])
        self._put_back(rows, start)
        self._ground.press(rows, self._stance(rows))
        self._ground.hold(rows, heading, self._relative_pull(rows), self.pull.height)

    def _put_back(self, rows: np.ndarray, start: Array) -> None:
        """Undo the drift, about a micrometre, from poses `start` (R, 3) while the robots `rows`
        (R,) settled.
        """
        qpos = self.state.qpos
        qpos[rows, :2] = start[:, :2]

        # the quaternion of a rotation about z, times that of the robot
        half_turn = (start[:, 2] - self.state.heading[rows]) / 2
        cos = np.cos(half_turn)
        sin = np.sin(half_turn)
        w, x, y, z = qpos[rows, 3:7].T
        turned = [cos * w - sin * z, cos * x - sin * y, cos * y + sin * x, cos * z + sin * w]
        qpos[rows, 3:7] = np.column_stack(turned)

        self.state.qvel[rows] = 0.0
        self.batch.time[rows] = 0.0
        self._heading[rows] = start[:, 2]

    def _relative_pull(self, rows: np.ndarray) -> Array:
        """Pull (R,) on the robots `rows` (R,) relative to their normal force [-]."""
        masses = self.batch.expanded("body_mass")
        gravity = float(np.linalg.norm(self.robot.model.opt.gravity))
        mass = self.robot.mass if masses is None else masses[rows].sum(axis=1)
        normal_force = mass * gravity * np.cos(self._ground.slope[rows])
        return self._present_pull(rows) / normal_force

    def needed_traction(self) -> Array:
        """Tractions (N, 2) per normal force, forwards and to the left, that keep the robots'
        velocity constant [-].
        """
        direction = self._ground.uphill - self.pose()[:, 2]
        steepness = np.tan(self._ground.slope)
        along = steepness * np.cos(direction) + self._relative_pull(np.arange(self.size))
        return np.stack([along, steepness * np.sin(direction)], axis=-1)


def _new_shear(robot: Robot, size: int, drive: Drive) -> Shear:
    """Shear of the ground under `size` robots: in one patch per track, or in one per wheel."""
    shape = robot.parameters
    patches = len(shape.axles) if shape.axles else 1
    length = shape.patch_length if shape.axles else shape.contact_length
    fastest = (1 + MAX_RADIUS_ERROR) * drive.top_speed
    return Shear(robot.pad_position, patches, length, size, drive.period, fastest)


def _new_ruts(robot: Robot, size: int, drive: Drive) -> Ruts:
    """Ruts of `size` robots."""
    shape = robot.parameters
    radius = float(robot.model.geom_size[robot.pads][0, 0])
    place = robot.pad_position
    if shape.axles:
        return WheelRuts(
            place,
            shape.patch_length,
            shape.track_width,
            size,
            drive.period,
            radius,
            shape.axles,
            shape.sprocket_radius,
        )
    return Ruts(place, shape.contact_length, shape.track_width, size, drive.period, radius)


def _along(forces: Array, forward: Array) -> Array:
    """Components (..., 2) along `forward` (..., 2) of forces (..., 6) on the left and right
    tracks.
    """
    x = forces[..., 0::3]
    y = forces[..., 1::3]
    return x * forward[..., :1] + y * forward[..., 1:]


@dataclass(frozen=True)
class RunSetup:
    """Start and properties of a robot in one run."""

    start: tuple[float, float, float]
    """Start pose (x, y, phi) [m, m, rad]."""
    ground: Ground = field(default_factory=Ground)
    """Ground under the robot."""
    radius_error: float | None = None
    """Relative error of the effective sprocket radius, real / nominal - 1; None for the robot's
    [-].
    """
    lag: float | None = None
    """Time constant of the servos; None for the drive's own [s]."""
    com_offset: tuple[float, float] = (0.0, 0.0)
    """Offset of the centre of mass from the model's, forwards and to the left [m]."""
    mass: float = 1.0
    """Factor on the mass and inertia of the chassis [-]."""
