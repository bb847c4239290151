"""Path tracking as a learning task for N robots, one row each: actions in, observations and rewards
out.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Final, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.common.settings import converted
from sim.fleet.fleet import Fleet
from sim.learning.task import Element, Floats, Task
from sim.motors.motor import or_tireless
from sim.path_tracking.config import PERIOD, EnvConfig, TrackingLayout
from sim.path_tracking.episode import Episode, Index, ReferenceTable, draw
from sim.path_tracking.randomization import MAX_LATENCY, Randomization
from sim.robot.robot import load_robot
from sim.runs.pose_source import NoisyPose, ScannedPose, TruePose
from sim.scanner.feed import ScannerFeed
from trackslip.kinematics import Array, RobotGeometry, limit_sprocket_speeds, track_speeds
from trackslip.laws.base import SlipLaw
from trackslip.laws.file import SHIPPED
from trackslip.localization.plate import PlateLocator
from trackslip.metrics import LOST, body_errors
from trackslip.online.compensation import Compensation, SensesLoad, known_law, named_compensation
from trackslip.trajectory.base import Reference
from trackslip.trajectory.drivable import require_drivable

_TIPPED: Final = np.cos(0.5)  # cosine of the lean beyond which a robot has tipped over
_STANDING: Final = 0.05  # sprocket speed below which a track's slip counts as 0 [rad/s]


class PathTracking(Task):
    """The task in which robots follow references."""

    STATE = (
        "fleet",
        "table",
        "_source",
        "_reference",
        "last",
        "_k",
        "_latency",
        "_line",
        "_angle",
        "_omega",
        "_pose",
        "_measured",
        "_error",
        "_seen_error",
        "_success",
        "_compensation",
        "_load",
        *Task.STATE,
    )

    def __init__(self, config: EnvConfig, size: int, threads: int = 0) -> None:
        """Prepare `size` robots on `threads` worker threads (0: one per processor); `begin` starts
        their episodes.
        """
        robot = load_robot(parameters=config.parameters)
        previews = np.arange(config.previews + 1) * config.stride
        top_speed = or_tireless(config.parameters.drive).top_speed
        law = _first_law(config, robot.geometry)

        def drivable(name: str) -> Reference:
            """A reference that the robots can follow; raises InvalidValueError for others."""
            reference = config.load_reference(name)
            require_drivable("reference", name, reference, law, robot.geometry, top_speed)
            return reference

        self.table = ReferenceTable(config.references, previews, drivable)
        begin = np.tile(self.table.path(0)[0], (size, 1))
        self.fleet = Fleet(
            robot,
            begin,
            radius_error=0.0,
            threads=threads,
            pull=config.pull,
            shears=config.shears,
            sinks=config.sinks,
        )
        self.layout = TrackingLayout(config, self.fleet.drive.limit)
        commanded = _commanded(config, self.fleet.drive.limit)
        super().__init__(config, size, PERIOD, self.layout.elements, commanded)
        self._compensation = _compensation(config, robot.geometry)
        # stored because the check of a protocol is slow
        self._senses_load = isinstance(self._compensation, SensesLoad)
        self._compensation.reset(begin)
        self._source = _pose_source(config, self.fleet, self._compensation)
        # (1, 2) units of the actions
        self._unit = np.array([[element.scale for element in self.commanded]])
        self._reference: Index = np.zeros(size, int)
        self.last: Index = np.zeros(size, int)  # last step (N,) in each robot's episode
        self._k: Index = np.zeros(size, int)  # control periods (N,) since each episode began
        self._latency: Index = np.zeros(size, int)
        # set points that the latency delays, newest first [rad/s]
        self._line = np.zeros((size, MAX_LATENCY + 1, 2))
        self._rows = np.arange(size)
        # encoder angles (N, 2) at the end of the last control period [rad]
        self._angle: Array = np.zeros((size, 2))
        self._omega: Array = np.zeros((size, 2))
        self._pose: Array = np.zeros((size, 3))  # true poses (N, 3)
        self._measured: Array = np.zeros((size, 3))
        self._error: Array = np.zeros((size, 3))  # true errors (N, 3)
        self._seen_error: Array = np.zeros((size, 3))  # observed errors (N, 3)
        # tractions that the robots need per load on the tracks [-]
        self._load: Array = np.zeros((size, 2))
        self._success = np.ones(size, bool)

    def get_state(self) -> dict[str, Any]:
        """Return a copy of the state, see Restorable, with the randomization, which may have been
        set later.
        """
        return super().get_state() | {"randomization": self.config.randomization}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a state from `get_state`, see Restorable."""
        super().set_state(state)
        kinds = Randomization | str | None
        randomization = converted("randomization", state["randomization"], kinds)
        if randomization != self.config.randomization:
            self.config = dataclasses.replace(self.config, randomization=randomization)

    def path(self, row: int) -> Array:
        """Poses (T, 3) on the reference of the robot `row`, from start to end."""
        return self.table.path(int(self._reference[row]))

    def draw(self, generator: np.random.Generator, options: Mapping[str, Any]) -> Episode:
        """Draw a robot's episode from the robot's own generator; see `episode.draw`."""
        return draw(self.config, self.table, generator, options)

    def begin(self, rows: Sequence[int], episodes: Sequence[Episode]) -> None:
        """Begin an episode with each of the robots `rows` (R,); raises InvalidValueError if a robot
        can't park.
        """
        where = np.asarray(rows, int)
        if not where.size:
            return
        self.fleet.restart(where, [episode.setup for episode in episodes])
        self._reference[where] = [episode.reference for episode in episodes]
        self.last[where] = self.table.last[self._reference[where]]
        self._latency[where] = [episode.latency for episode in episodes]
        self._clear(where, self._k, self._line, self._angle, self._omega)
        self._source.begin(where, [episode.noise for episode in episodes], self.last[where])
        self._pose = self.fleet.pose()
        desired = self.table.pose(self._reference, self._k)
        self._measured[where] = self._source.start(where)
        self._error[where] = body_errors(self._pose, desired)[where]
        self._compensation.restart(where, self._pose[where])
        self._seen_error[where] = body_errors(self._seen_pose(), desired)[where]
        self._success[where] = np.hypot(*self._error[where, :2].T) <= LOST

    def step(self, actions: ArrayLike) -> None:
        """Simulate one control period; see Task."""
        action, change = self._clipped(actions)

        # set points reach the servos after the latency
        self._line[:, 1:] = self._line[:, :-1].copy()
        self._line[:, 0] = self._set_points(action)
        self.fleet.drive.command(self._line[self._rows, self._latency])
        self.fleet.advance(PERIOD)
        self._k += 1

        # what the robots measure
        angle = self.fleet.drive.encoder_angle()
        self._omega = (angle - self._angle) / PERIOD
        self._angle = angle
        self._pose = self.fleet.pose()
        estimate = self._source.estimate(self._k, self._omega, self._pose, PERIOD)
        self._measured = estimate.pose
        self._compensation.observe(self._omega, PERIOD, estimate)
        seen = self._seen_pose()
        desired = self.table.pose(self._reference, self._k)
        self._error = body_errors(self._pose, desired)
        is_exact = seen is self._pose  # whether the truth is observed
        self._seen_error = self._error if is_exact else body_errors(seen, desired)

        # what is true, for the reward and the end of the episode
        ahead, left, turn = self._error.T
        distance = np.hypot(ahead, left)
        self._success &= distance <= LOST
        is_on_path = distance <= self.config.off_path
        is_upright = self.fleet.state.upright > _TIPPED
        self.terminated = ~(is_on_path & is_upright)
        self.truncated = (self._k >= self.last) & ~self.terminated
        self._earn(self.config.reward.terms(distance, turn, change, self.terminated))

    @property
    def _loaded(self) -> SensesLoad | None:
        return cast(SensesLoad, self._compensation) if self._senses_load else None

    def _set_points(self, action: Array) -> Array:
        """Set points (N, 2) of the sprockets for actions (N, 2) [rad/s]."""
        wanted = action * self._unit
        if self.config.action == "sprockets":
            return wanted
        law = self._compensation.law()
        omega = law.sprocket_speeds(wanted, self.fleet.robot.geometry)
        return limit_sprocket_speeds(omega, self.fleet.drive.limit)

    def _seen_pose(self) -> Array:
        """Observed poses (N, 3), with headings corrected by the crab angles that the compensation
        predicts.
        """
        if self.config.loads or self._loaded is not None:
            self._load = self.fleet.needed_traction()
        if self._loaded is None:
            return self._measured
        self._loaded.sense(self._load)
        twist = self._compensation.law().twist(self._omega, self.fleet.robot.geometry)
        pose = self._measured.copy()
        pose[:, 2] += self._loaded.crab_angle(twist)
        return pose

    def _observed(self) -> Floats:
        twists = self.table.twists(self._reference, self._k)
        load = self._load if self.config.loads else None
        return self.layout.observation(self._seen_error, twists, self._omega, self._action, load)

    def _quantities(self) -> dict[str, NDArray[Any]]:
        twist = self.fleet.twist()
        return {
            "time": self._k * PERIOD,  # [s]
            "reference": self._reference,  # index in `table.names`
            "true_pose": self._pose,  # (N, 3) [m, m, rad]
            "true_twist": twist,  # (N, 3) forwards, to the left [m/s], yaw rate [rad/s]
            "true_error": self._error,  # (N, 3) in the robot's frame [m, m, rad]
            "true_slip": self._slip(twist),  # (N, 2); 0 where a sprocket is at rest [-]
            "measured_pose": self._measured,  # (N, 3) [m, m, rad]
            "measured_omega": self._omega,  # (N, 2) [rad/s]
            "set_point": self.fleet.drive.set_point,  # (N, 2) [rad/s]
            "torque": self.fleet.drive.torque,  # (N, 2) motor torques at the sprockets [N m]
            "energy": self.fleet.drive.energy,  # (N, 2) energy drawn by the motors so far [J]
            # (N, 2) along and across, averaged over the pads [-]
            "friction": self.fleet.friction(),
            # whether the robot has always stayed within metrics.LOST of the reference
            "success": self._success,
        }

    def _slip(self, twist: Array) -> Array:
        """Slips (N, 2) of the tracks of robots with twists (N, 3) [-]."""
        omega = self.fleet.drive.omega
        geometry = self.fleet.robot.geometry
        tracks = track_speeds(twist[:, ::2], geometry.half_gauge)
        rests = np.abs(omega) < _STANDING
        belts = geometry.sprocket_radius * omega + rests  # 1 more at rest, to divide by
        return ~rests * (1 - tracks / belts)


def _commanded(config: EnvConfig, limit: float) -> tuple[Element, Element]:
    """The elements of an action; `limit` is the sprockets' top speed [rad/s]."""
    if config.action == "sprockets":
        left = Element("left sprocket speed", "rad/s", limit)
        right = Element("right sprocket speed", "rad/s", limit)
        return left, right
    speed, rate = config.twist_scale
    return Element("speed", "m/s", speed), Element("yaw rate", "rad/s", rate)


def _pose_source(config: EnvConfig, fleet: Fleet, compensation: Compensation) -> TruePose:
    if config.pose_source == "truth":
        return TruePose(fleet)
    if config.pose_source == "noisy":
        position = config.position_noise
        return NoisyPose(fleet, (position, position, config.heading_noise))
    feed = ScannerFeed(config.scanner, fleet)
    locator = PlateLocator(fleet.robot.plate)
    return ScannedPose(fleet, feed, locator, [(range(fleet.size), compensation)])


def _compensation(config: EnvConfig, geometry: RobotGeometry) -> Compensation:
    if isinstance(config.compensation, SlipLaw):
        return known_law(config.compensation)
    return named_compensation(config.compensation, geometry, config.laws or SHIPPED)


def _first_law(config: EnvConfig, geometry: RobotGeometry) -> SlipLaw:
    """The law with which an episode begins."""
    compensation = _compensation(config, geometry)
    compensation.reset(np.zeros((1, 3)))
    return compensation.law()
