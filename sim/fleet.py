"""Fleet: N robots, each in a world of its own, stepped together by mujoco.batch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mujoco import batch
from numpy.typing import ArrayLike

from sim.drive import RADIUS_ERROR, Drive, DriveState
from sim.ground import Ground
from sim.pad_friction import PadFriction
from sim.robot import Robot
from sim.saturation import SpeedSearch
from trackslip.errors import InvalidValueError
from trackslip.kinematics import Array

_SETTLING = 1.0  # time for a robot set down on the ground to come to rest [s]
_AT_REST = 0.005  # below this speed [m/s] it has; creep is a hundred times slower
_UPRIGHT = 0.1  # below this roll and pitch it stands on its tracks [rad]


class Fleet:
    """N robots on their grounds. Same arguments, same bits, at any number of threads."""

    def __init__(
        self,
        robot: Robot,
        start: ArrayLike,
        ground: Ground | Sequence[Ground] | None = None,
        radius_error: ArrayLike = RADIUS_ERROR,
        drive: Drive | None = None,
        threads: int = 0,
    ) -> None:
        """Set N robots down, tracks at rest.

        Args:
            robot: the compiled model.
            start: poses (N, 3).
            ground: of all robots, or one each.
            radius_error: of the effective sprocket radius, one number or (N,) [-].
            drive: of all sprockets.
            threads: worker threads, 0 for one per processor.

        Raises:
            InvalidValueError: for poses that aren't finite, a wrong number of grounds, a slope too steep to park on,
                where robots would slide or tip over, a servo period that is no multiple of the physics step.
        """
        start = np.atleast_2d(np.asarray(start, float))
        if start.ndim != 2 or start.shape[1] != 3 or not np.isfinite(start).all():
            raise InvalidValueError("start", start.tolist(), "N finite poses (x, y, phi)")
        if threads < 0:
            raise InvalidValueError("threads", threads, "0 (one per processor) or more")
        self.robot = robot
        self.size = len(start)
        self._radius = robot.geometry.sprocket_radius * (1 + np.broadcast_to(radius_error, (self.size,)))[:, None]
        drive = drive or Drive()
        self.drive = DriveState(drive, self.size, robot.geometry.sprocket_radius, self._radius)
        self.period = drive.period
        step = robot.model.opt.timestep
        self._substeps = round(drive.period / step)
        if self._substeps < 1 or abs(self._substeps * step - drive.period) > 1e-9:
            raise InvalidValueError("drive.period", drive.period, f"a multiple of the physics step, {step} s")

        self.batch = batch.Batch(robot.model, self.size, nthread=threads)
        surface = self.batch.expand("geom_surfacevel")  # (N, ngeom, 6)
        self.belts = surface[:, robot.pads, 2]
        """Speed of each pad's surface, along its own axis (N, P) [m/s], live."""
        self._pad_friction = self.batch.expand("pair_friction")[:, robot.pad_pairs, :2]  # (N, P, 2), live
        self._sensors = self.batch.bind("sensordata")[:, :6]  # (N, 6), live: force on the left and on the right track
        self._quaternion = tuple(self.batch.qpos[:, 3:7].T)  # four live views (N,)
        # (N, 2), live: the chassis' x axis on the ground
        self._forward = self.batch.bind("xmat")[:, robot.model.body("chassis").id, 0:4:3]
        self.plate = self.batch.bind("geom_xpos")[:, robot.model.geom("plate").id]
        """Middles (N, 3) of the robots' plates one physics step ago [m], live."""
        self._gravity: Array | None = None  # (N, 3), live, once some ground slopes
        self._heading: Array = np.zeros(self.size)  # unwrapped
        self._periods = 0  # since the start
        fastest = drive.top_speed / robot.geometry.half_gauge * drive.period  # turn in a period [rad]
        self._unwrap_every = max(1, int(1.0 / fastest))  # periods
        self._place_at(start)
        self.set_ground(ground or Ground())
        for g, friction, heading in zip(self.ground, self._pad_friction, start[:, 2], strict=True):
            g.require_parking(friction.mean(axis=0), float(heading))
        self._settle(start)

    @property
    def time(self) -> float:
        """Since the start [s]."""
        return self._periods * self.period

    def set_ground(self, ground: Ground | Sequence[Ground]) -> None:
        """Put the robots on a ground, all the same or one each; takes effect at once, also in mid-run."""
        grounds = [ground] * self.size if isinstance(ground, Ground) else list(ground)
        if len(grounds) != self.size:
            raise InvalidValueError("ground", f"{len(grounds)} grounds", f"one or {self.size}")
        self.ground = tuple(grounds)
        self._friction = PadFriction(grounds, self.robot.pad_position)
        if self._gravity is None and any(g.slope != 0 for g in grounds):
            self._gravity = self.batch.expand("opt.gravity")
        if self._gravity is not None:
            self._gravity[:] = [g.gravity(-float(self.robot.model.opt.gravity[2])) for g in grounds]
        self._lay_friction()

    def command(self, omega: ArrayLike) -> None:
        """Set points of the sprockets, (N, 2) or (2,) [rad/s]; they hold until the next."""
        self.drive.command(np.broadcast_to(np.asarray(omega, float), (self.size, 2)))

    def advance(self, duration: float) -> None:
        """Let `duration` [s] pass; raises InvalidValueError unless it is a multiple of the servo period."""
        periods = round(duration / self.period)
        if abs(periods * self.period - duration) > 1e-9:
            raise InvalidValueError("duration", duration, f"a multiple of the servo period, {self.period} s")
        if periods == 0:
            return
        before = self._snapshot()
        forecast = self.drive.forecast(periods)
        torque = self.drive.torque_for(forecast, self._run(forecast.mean))
        if not self.drive.too_weak(forecast, torque).any():
            self.drive.accept(forecast, torque)
            return
        self._restore(before)
        for _ in range(periods):
            self._advance_within_limits()

    def _run(self, mean: Array) -> Array:
        """Run the belts at mean sprocket speeds (P, N, 2) [rad/s] for P periods; mean tractions (P, N, 2) in them."""
        # the lower side of a belt runs backwards when the robot goes forwards
        belts = (-self._radius * mean)[..., self.robot.pad_side] * self.robot.pad_sign
        forces = np.empty((len(mean), *self._sensors.shape))
        forward = np.empty((len(mean), self.size, 2))
        for k, speed in enumerate(belts):
            if self._friction.varies:
                self._lay_friction()
            self.belts[:] = speed
            # grip follows the belts within a period: only the mean of the forces is their impulse
            recorded = self.batch.rollout(self._substeps, record=("sensordata",))["sensordata"]
            forces[k] = recorded[..., : forces.shape[-1]].sum(axis=1)
            forward[k] = self._forward
            self._periods += 1
            if (k + 1) % self._unwrap_every == 0:
                self._follow_heading()
        self._follow_heading()
        return _along(forces / self._substeps, forward)

    def _advance_within_limits(self) -> None:
        """One period in which some motor may be too weak to follow its servo.

        Its sprocket then ends at a speed for which it has just enough torque. What the ground makes of a speed is found
        by trying it.
        """
        before = self._snapshot()
        search = SpeedSearch(self.drive, self.robot.mass, float(np.linalg.norm(self.robot.model.opt.gravity)))
        while not search.done(self._run(search.belt)):
            self._restore(before)

    def _snapshot(self) -> tuple[Array, Array, int]:
        return self.batch.state.copy(), self._heading.copy(), self._periods

    def _restore(self, snapshot: tuple[Array, Array, int]) -> None:
        self.batch.state[:], self._heading, self._periods = snapshot[0], snapshot[1].copy(), snapshot[2]

    def pose(self) -> Array:
        """True poses (N, 3) of the chassis [m, m, rad]; phi unwrapped."""
        qpos = self.batch.qpos
        return np.column_stack([qpos[:, 0], qpos[:, 1], self._heading])

    def twist(self) -> Array:
        """True twists (N, 3): forward speed, lateral speed to the left [m/s], yaw rate [rad/s]."""
        velocity = self.batch.qvel
        cos, sin = np.cos(self._heading), np.sin(self._heading)
        x, y = velocity[:, 0], velocity[:, 1]
        return np.column_stack([cos * x + sin * y, -sin * x + cos * y, velocity[:, 5]])

    def traction(self) -> Array:
        """Forces of the ground on the (left, right) tracks, along the robot, (N, 2) [N], in the last physics step."""
        return _along(self._sensors, self._forward)

    def load(self) -> Array:
        """Forces of the ground that hold up the (left, right) tracks, (N, 2) [N]."""
        return self._sensors[:, 2::3].copy()

    def attitude(self) -> Array:
        """Sink (positive downwards) [m], roll and pitch [rad] of the chassis, (N, 3)."""
        w, x, y, z = self._quaternion
        roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
        return np.column_stack([-self.batch.qpos[:, 2], roll, pitch])

    def lean(self) -> Array:
        """How far the plates stand to the left of the chassis, at the height at which they are scanned (N,) [m]."""
        w, x, y, z = self._quaternion
        up = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])  # of the chassis
        along = (self.robot.lrf_height - self.batch.qpos[:, 2]) / up[2]
        return along * (np.cos(self._heading) * up[1] - np.sin(self._heading) * up[0])

    def _lay_friction(self) -> None:
        """Give every pad the friction of the place and the time."""
        self._pad_friction[:] = self._friction.at(self.time, self.batch.qpos[:, :2], self._wrapped_heading())

    def _place_at(self, start: Array) -> None:
        qpos = self.batch.qpos
        qpos[:, :3] = np.column_stack([start[:, :2], np.zeros(self.size)])
        qpos[:, 3:7] = _yaw_quaternion(start[:, 2])

    def _settle(self, start: Array) -> None:
        """Let the robots come to rest on the ground, at the poses `start` (N, 3)."""
        qpos = self.batch.qpos
        self.batch.step(nstep=round(_SETTLING / self.robot.model.opt.timestep))
        self._require_rest(start)
        # settling moves it by less than a micrometre; start exactly where asked
        qpos[:, :2] = start[:, :2]
        half_turn = (start[:, 2] - self._wrapped_heading()) / 2
        cos, sin = np.cos(half_turn), np.sin(half_turn)
        w, x, y, z = qpos[:, 3:7].T.copy()
        qpos[:, 3:7] = np.column_stack([cos * w - sin * z, cos * x - sin * y, cos * y + sin * x, cos * z + sin * w])
        self.batch.qvel[:] = 0
        self.batch.time[:] = 0
        self._heading = start[:, 2].copy()
        self._follow_heading()

    def _require_rest(self, start: Array) -> None:
        """Raise InvalidValueError for robots that slide, or have tipped over, where they were set down."""
        sliding = ~(np.hypot(*self.batch.qvel[:, :2].T) < _AT_REST)
        tipped = ~(np.abs(self.attitude()[:, 1:]).max(axis=1) < _UPRIGHT)
        for k in np.flatnonzero(sliding | tipped)[:1]:
            what = "tips over" if tipped[k] else "slides"
            raise InvalidValueError(
                "slope",
                self.ground[k].slope,
                f"less, to park with heading {round(float(start[k, 2]), 3) + 0:g} rad: the robot {what}",
            )

    def _wrapped_heading(self) -> Array:
        w, x, y, z = self._quaternion
        return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

    def _follow_heading(self) -> None:
        """Unwrap the heading, often enough: a robot may have turned by a radian since the last time."""
        wrapped = self._wrapped_heading()  # plus whole turns: the same bits however often it is followed
        self._heading = wrapped + 2 * np.pi * np.round((self._heading - wrapped) / (2 * np.pi))


def _along(forces: Array, forward: Array) -> Array:
    """Parts (..., 2) along the directions `forward` (..., 2) of forces (..., 6) on the left and on the right track."""
    x, y = forces[..., 0::3], forces[..., 1::3]
    return x * forward[..., :1] + y * forward[..., 1:]


def _yaw_quaternion(heading: Array) -> Array:
    zero = np.zeros_like(heading)
    return np.column_stack([np.cos(heading / 2), zero, zero, np.sin(heading / 2)])
