"""Options of the environment trackslip/PathTracking-v0, and the elements of its observations."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, Final

import numpy as np

from sim.ground.ground import Ground, load_ground
from sim.ground.pull import Pull
from sim.learning.task import MAX_WEIGHT, Element, Floats, OwnTerms
from sim.motors.motor import or_tireless
from sim.path_tracking.randomization import Randomization
from sim.robot.named import SHIPPED, RobotSource, load_parameters
from sim.robot.parameters import RobotParameters
from sim.scanner.scanner import LaserScanner
from trackslip.arguments import checks_arguments
from trackslip.errors import (
    Checked,
    checked,
    require,
    require_at_most,
    require_non_negative,
    require_one_of,
    require_positive,
    require_whole,
    require_within,
)
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.base import TURNING_LAWS, SlipLaw
from trackslip.laws.file import SHIPPED as SHIPPED_LAWS
from trackslip.online.compensation import KNOWN_LAWS, named_compensation
from trackslip.trajectory.base import Reference
from trackslip.trajectory.named import load_reference
from trackslip.trajectory.path import LIMITS, MIN_SPEED
from trackslip.trajectory.turns import require_turns
from trackslip.trajectory.waypoints import MAX_TOLERANCE, TOLERANCE_SHARE

PERIOD: Final = 0.05
"""Control period: the time between actions and between scans [s]."""
_ACTIONS: Final = ("sprockets", "twist")
_POSE_SOURCES: Final = ("truth", "noisy", "scanner")
MAX_SPEED: Final = 10.0
"""Largest speed along a path [m/s]."""
_MAX_PREVIEWS: Final = 100
_MIN_OFF_PATH: Final = 0.001  # [m]
_MIN_SCALE: Final = 1e-6  # in the scale's own unit
_MAX_PREVIEW: Final = 20.0  # longest look-ahead of previews [s]
_BOUND: Final = 2.0  # of most elements [-]
_LOAD_SCALE: Final = 0.5  # traction per normal force at which an element is 1 [-]
_ROUNDING: Final = 1e-9  # tolerance on times, and on shares of a period


@dataclass(frozen=True)
class TrackingReward(Checked):
    """Reward for a step: a sum of terms, which `info` lists by name.

        alive               weight_alive
        position            -weight_position s(d / position_scale)
        heading             -weight_heading s(e_phi / heading_scale)
        change              -weight_change mean((a - a_before)^2) / 4
        termination         -weight_termination, if the robot leaves the path or tips over

    with s(z) = z^2 / (1 + z^2), the distance d between the robot's true position and the
    reference's current one, the true heading error e_phi and the actions a in [-1, 1]. s is
    quadratic for small errors and never exceeds 1, so the reward lies between weight_alive minus
    the other weights and weight_alive. By default this range is 0 to 1: no step on the path is
    worse than leaving the path.
    """

    TERMS: ClassVar = ("alive", "position", "heading", "change", "termination")

    weight_alive: float = checked(1.0, require_non_negative, MAX_WEIGHT)
    """Reward for every step [-]."""
    weight_position: float = checked(0.7, require_non_negative, MAX_WEIGHT)
    """Weight of the position error [-]."""
    weight_heading: float = checked(0.2, require_non_negative, MAX_WEIGHT)
    """Weight of the heading error [-]."""
    weight_change: float = checked(0.1, require_non_negative, MAX_WEIGHT)
    """Weight of changes in the action [-]."""
    weight_termination: float = checked(10.0, require_non_negative, MAX_WEIGHT)
    """One-time penalty for an episode that ends off the path [-]."""
    position_scale: float = checked(0.05, require_within, _MIN_SCALE, MAX_WEIGHT)
    """Position error at which half of `weight_position` is lost [m]."""
    heading_scale: float = checked(0.2, require_within, _MIN_SCALE, MAX_WEIGHT)
    """Heading error at which half of `weight_heading` is lost [rad]."""

    def terms(
        self, distance: Array, heading: Array, change: Array, terminated: np.ndarray
    ) -> Array:
        """Terms (5, N) of the reward, in the order of `TERMS`.

        The terms depend on position and heading errors (N,) [m, rad], changes in the actions (N, 2)
        [-], and a mask (N,) of terminated episodes.
        """
        left, right = change.T
        terms = np.empty((len(self.TERMS), len(change)))
        terms[0] = self.weight_alive
        terms[1] = -self.weight_position * _bounded_square(distance / self.position_scale)
        terms[2] = -self.weight_heading * _bounded_square(heading / self.heading_scale)
        terms[3] = -self.weight_change * (left * left + right * right) / 8
        terms[4] = -self.weight_termination * terminated
        return terms


def _bounded_square(z: Array) -> Array:
    square = z * z
    return square / (1 + square)


@checks_arguments
@dataclass(frozen=True)
class EnvConfig(OwnTerms):
    """Options of a path-tracking task."""

    reference: str | tuple[str, ...] = "paper"
    """Name of a reference, or a .csv file of waypoints; each episode draws one if there are
    several.
    """
    speed: float = checked(LIMITS.speed, require_within, MIN_SPEED, MAX_SPEED, "m/s")
    """Speed along the paths of .csv files, lower in bends [m/s]."""
    tolerance: float | None = None
    """Distance by which a path may miss the points of a .csv file where that smooths bends; None
    for a tenth of the robot's half gauge [m].
    """
    ground: str | tuple[str, ...] = "stone"
    """Name of a ground, a .toml file, or "robot" for the ground in the robot's file; each episode
    draws one if there are several.
    """
    action: str = "sprockets"
    """Meaning of the actions in [-1, 1]: "sprockets" for set points (left, right) in units of the
    top speed, "twist" for body twists (v, w) in units of `twist_scale`.
    """
    twist_scale: tuple[float, float] = (0.3, 1.0)
    """Unit of the twists in actions and observations [m/s, rad/s]."""
    compensation: str | SlipLaw = "none"
    """Slip law that converts twists into sprocket speeds, or the name of a compensation: "none";
    "published"; a law in `laws`; "online" or "online_load", which start from laws in `laws` and
    learn while driving, anew in each episode; or "online_cold", which starts without slip. Laws for
    slip under load use the load from slope and pull.
    """
    laws: str | None = None
    """File of the laws that `compensation` can name; None for the laws shipped with trackslip."""
    previews: int = checked(5, require_whole, 0, _MAX_PREVIEWS)
    """Number of future reference twists in the observation."""
    preview_spacing: float = checked(0.2, require_positive, _MAX_PREVIEW, "s")
    """Time between previews; a multiple of the control period [s]."""
    pose_source: str = "truth"
    """Source of the observed pose: "truth"; "noisy", the truth plus Gaussian noise; or "scanner",
    the plate in the laser range finder's scans, tracked from the known start.
    """
    position_noise: float = checked(0.002, require_non_negative, 1.0)
    """Standard deviation of noisy positions, in x and in y [m]."""
    heading_noise: float = checked(math.radians(0.25), require_non_negative, 1.0)
    """Standard deviation of noisy headings [rad]."""
    scanner: LaserScanner = field(default_factory=LaserScanner)
    """Laser range finder for poses from the scanner; it scans once per control period."""
    pull: Pull = field(default_factory=Pull)
    """Load towed by the robot."""
    loads: bool = False
    """Whether to observe the load from slope and pull, which an inclinometer and a load cell at the
    hitch measure.
    """
    off_path: float = checked(0.5, require_within, _MIN_OFF_PATH, 10.0, "m")
    """Distance from the reference beyond which an episode terminates [m]."""
    reward: TrackingReward = field(default_factory=TrackingReward)
    """Reward for a step."""
    randomization: Randomization | str | None = None
    """Properties that vary between episodes; "typical" stands for Randomization.typical()."""
    robot: RobotSource = SHIPPED
    """Name of a robot, its .toml file, or the robot itself."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of("action", self.action, _ACTIONS)
        require_one_of("pose_source", self.pose_source, _POSE_SOURCES)
        if self.tolerance is not None:
            require_within("tolerance", self.tolerance, 0.0, MAX_TOLERANCE, "m")
        self._require_compensation()
        for name, names in (("reference", self.reference), ("ground", self.ground)):
            valid = names and all(isinstance(value, str) for value in _several(names))
            require(valid, name, names, "a name, or a tuple of names")
        for ground in self.grounds:
            self.load_ground(ground)
        self._require_periods()
        self._require_randomization()

    def _require_compensation(self) -> None:
        """Raise InvalidValueError for a compensation or a file of laws without an effect."""
        is_used = self.action == "twist" or self.compensation == "none"
        require(is_used, "compensation", self.compensation, '"none" unless action is "twist"')
        is_named = isinstance(self.compensation, str)
        in_file = is_named and self.compensation not in (*KNOWN_LAWS, "online_cold")
        allowed = "None unless compensation names a law in a file"
        require(self.laws is None or in_file, "laws", self.laws, allowed)

    def _require_periods(self) -> None:
        """Raise InvalidValueError for scales, previews and a scanner that don't fit the period."""
        require(len(self.twist_scale) == 2, "twist_scale", self.twist_scale, "two numbers")
        for scale in self.twist_scale:
            require_within("twist_scale", scale, _MIN_SCALE, 100.0)
        spacing = self.preview_spacing
        is_multiple = self.stride >= 1 and abs(self.stride * PERIOD - spacing) <= _ROUNDING
        require(is_multiple, "preview_spacing", spacing, f"a multiple of {PERIOD} s")
        require_at_most("previews * preview_spacing", self.previews * spacing, _MAX_PREVIEW, "s")
        rate = self.scanner.rate
        is_once = abs(rate * PERIOD - 1) <= _ROUNDING
        require(is_once, "scanner.rate", rate, f"{1 / PERIOD:g} Hz, once in a control period")

    def _require_randomization(self) -> None:
        """Raise InvalidValueError for a randomization that makes robots tip over or begin off the
        path.
        """
        drawn = self.randomization
        if isinstance(drawn, Randomization):
            has_effect = not self.is_soft or drawn == drawn.on_soft_soil()
            allowed = "without friction_ratio, patches and shear, which soft soil has not"
            require(has_effect, "randomization", drawn, allowed)
        else:
            is_named = drawn in (None, "typical")
            require(is_named, "randomization", drawn, 'a Randomization, "typical" or None')
        self.drawn.require_standing(self.parameters)
        distance = self.drawn.start_distance
        allowed = f"less than off_path = {self.off_path} m"
        require(distance[1] < self.off_path, "start_distance", distance, allowed)

    @cached_property
    def _robot_file(self) -> tuple[RobotParameters, Ground]:
        return load_parameters(self.robot)

    @property
    def parameters(self) -> RobotParameters:
        """Shape and mass of the robot."""
        return self._robot_file[0]

    def load_reference(self, name: str) -> Reference:
        """A reference by name or from a file; raises TrackslipError for unknown names, and for one
        that turns on the spot where the law of the compensation doesn't hold.
        """
        robot = self.parameters
        tolerance = self.tolerance
        if tolerance is None:
            tolerance = TOLERANCE_SHARE * robot.half_gauge
        limits = LIMITS
        if self.speed != LIMITS.speed:
            limits = LIMITS.scaled(self.speed, or_tireless(robot.drive).top_speed)
        reference = load_reference(name, limits, tolerance)
        law = self.compensation
        if isinstance(law, str):
            geometry = RobotGeometry(robot.half_gauge, robot.sprocket_radius)
            compensation = named_compensation(law, geometry, self.laws or SHIPPED_LAWS)
            compensation.reset(reference.pose([0.0]))
            law = compensation.law()
        require_turns(reference, "compensation", str(self.compensation), law, TURNING_LAWS)
        return reference

    def load_ground(self, name: str) -> Ground:
        """A ground by name, or "robot" for the ground in the robot's file; raises TrackslipError
        for unknown names.
        """
        return self._robot_file[1] if name == "robot" else load_ground(name)

    @property
    def references(self) -> tuple[str, ...]:
        """References from which episodes draw."""
        return _several(self.reference)

    @property
    def grounds(self) -> tuple[str, ...]:
        """Grounds from which episodes draw."""
        return _several(self.ground)

    @property
    def shears(self) -> bool:
        """Whether any of the grounds shears."""
        drawn = self.drawn.shear
        if drawn is not None and drawn[1] > 0:
            return True
        return any(self.load_ground(name).largest_shear > 0 for name in self.grounds)

    @property
    def is_soft(self) -> bool:
        """Whether all grounds are soft."""
        return all(self.load_ground(name).soil is not None for name in self.grounds)

    @property
    def sinks(self) -> bool:
        """Whether any of the grounds is soft."""
        return any(self.load_ground(name).soil is not None for name in self.grounds)

    @property
    def stride(self) -> int:
        """Number of control periods between previews."""
        return round(self.preview_spacing / PERIOD)

    @cached_property
    def drawn(self) -> Randomization:
        """Properties that vary between episodes."""
        if isinstance(self.randomization, Randomization):
            return self.randomization
        return Randomization() if self.randomization is None else Randomization.typical()


def _several(names: str | tuple[str, ...]) -> tuple[str, ...]:
    return (names,) if isinstance(names, str) else tuple(names)


class TrackingLayout:
    """The 9 + 2K elements of an observation, and 2 more with loads."""

    def __init__(self, config: EnvConfig, top_speed: float) -> None:
        """Determine the elements for sprockets with this `top_speed` [rad/s]."""
        self.steps = np.arange(config.previews + 1) * config.stride
        """Look-ahead times of the observed reference twists (K + 1,) [control periods]."""
        speed_scale, rate_scale = config.twist_scale
        elements = [
            Element("position error, ahead", "m", config.off_path, _BOUND),
            Element("position error, to the left", "m", config.off_path, _BOUND),
            Element("heading error", "rad", np.pi),
        ]
        for step in self.steps:
            time = "now" if step == 0 else f"in {step * PERIOD:g} s"
            elements += [
                Element(f"reference speed {time}", "m/s", speed_scale, _BOUND),
                Element(f"reference yaw rate {time}", "rad/s", rate_scale, _BOUND),
            ]
        elements += [
            Element("left sprocket speed", "rad/s", top_speed, _BOUND),
            Element("right sprocket speed", "rad/s", top_speed, _BOUND),
            Element("last action, first", "-", 1.0),
            Element("last action, second", "-", 1.0),
        ]
        if config.loads:
            elements += [
                Element("load, ahead", "-", _LOAD_SCALE, _BOUND),
                Element("load, to the left", "-", _LOAD_SCALE, _BOUND),
            ]
        self.elements = tuple(elements)
        """Names, units, scales and bounds of the elements."""
        self._scale = np.array([[element.scale for element in self.elements]])  # (1, n)
        self._bound = np.array([element.bound for element in self.elements], np.float32)

    def observation(
        self, error: Array, twist: Array, omega: Array, action: Array, load: Array | None = None
    ) -> Floats:
        """Observations (N, n) for errors (N, 3), twists (N, K + 1, 2), sprocket speeds, actions and
        loads (N, 2).
        """
        parts = [error, twist.reshape(len(error), -1), omega, action]
        if load is not None:
            parts.append(load)
        scaled = (np.concatenate(parts, axis=1) / self._scale).astype(np.float32)
        return np.minimum(np.maximum(scaled, -self._bound), self._bound)
