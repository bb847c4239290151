"""Slip compensation by a law for sprocket speeds, which is fixed or learnt while driving."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Final, Protocol, runtime_checkable

import numpy as np

from trackslip.arguments import checks_arguments
from trackslip.errors import InvalidValueError, TrackslipError, one_of
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.base import NoSlip, SlipLaw
from trackslip.laws.exponential import PUBLISHED
from trackslip.laws.file import SHIPPED, load_laws
from trackslip.laws.icr import MAX_LOAD, ConstantIcr, IcrLoad
from trackslip.localization.pose_estimate import PoseEstimate
from trackslip.odometry.law_in_use import LawInUse
from trackslip.odometry.slip_odometry import SlipOdometry
from trackslip.online.filter import FilterTuning, IcrFilter
from trackslip.restorable import Restorable

KNOWN_LAWS: Final[Mapping[str, SlipLaw]] = {"none": NoSlip(), "published": PUBLISHED}
"""The laws with which the paper compensates slip, which need no identification."""
MAX_CRAB_ANGLE: Final = 0.3
"""Maximum angle between a robot's heading and its direction of motion [rad]."""
# laws under load do not model how the turning centre moves along a robot that turns on a slope
_LOADED_TUNING: Final = FilterTuning(centre_spread=0.2, centre_walk=0.01)
# laws from which learning starts, by compensation
_PRIORS: Final = {"online": "icr_radius", "online_load": "icr_load"}


class Compensation(Protocol):
    """Provider of the slip laws of N robots. By default, the laws are not updated during runs."""

    def reset(self, start: Array) -> None:
        """Start a new run at poses (N, 3)."""
        return

    def restart(self, robots: np.ndarray, start: Array) -> None:
        """Start new runs for the robots with indices `robots` (R,), at poses (R, 3)."""
        return

    def observe(self, omega: Array, duration: float, estimate: PoseEstimate) -> None:
        """Process mean sprocket speeds (N, 2) [rad/s] over `duration` [s] and poses after it."""
        return

    @abstractmethod
    def law(self) -> SlipLaw:
        """The current slip law, with separate parameters for each robot where they differ."""

    def velocity(self, omega: Array, geometry: RobotGeometry) -> Array:
        """Velocities (N, 3) (forwards, leftwards, yaw) at sprocket speeds (N, 2) [rad/s]."""
        twist = self.law().twist(omega, geometry)
        return np.stack([twist[:, 0], np.zeros(len(twist)), twist[:, 1]], axis=1)

    def odometry(self, geometry: RobotGeometry) -> SlipOdometry | None:
        """Odometry by the current law, with what is known of its errors; None if nothing is."""
        return None


@runtime_checkable
class SensesLoad(Protocol):
    """A compensation that also uses the traction per unit load, for example on a slope."""

    def sense(self, load: Array) -> None:
        """Set the tractions per unit load (N, 2) [-], forwards and to the left, before `law`."""

    def crab_angle(self, twist: Array) -> Array:
        """Angles (N,) from headings left to directions of motion [rad], at twists (N, 2)."""


@checks_arguments
@dataclass(frozen=True)
class FixedLaw(Compensation, Restorable):
    """Compensation by a fixed law for all robots, by default none: the law without slip."""

    known: SlipLaw = field(default_factory=NoSlip)
    identified: LawInUse | None = None
    """The same law with its errors, if these are known."""

    def law(self) -> SlipLaw:
        """The fixed law."""
        return self.known

    def odometry(self, geometry: RobotGeometry) -> SlipOdometry | None:
        """Odometry by the fixed law, if its errors are known."""
        return _odometry(self.identified)


@checks_arguments
class LoadedLaw(Compensation, Restorable):
    """Compensation by a fixed law of slip under load, evaluated at the measured load."""

    STATE = ("_load",)

    def __init__(self, known: IcrLoad, identified: LawInUse | None = None) -> None:
        """Use a law; `identified` is the same law with its errors, if these are known."""
        self._known = known
        self._identified = identified
        # one pair without load for all robots, until a run begins
        self._load: Array = np.zeros(2)

    def reset(self, start: Array) -> None:
        """Start a new run at poses (N, 3), without load."""
        self._load = np.zeros((len(start), 2))

    def restart(self, robots: np.ndarray, start: Array) -> None:
        """Start new runs for the robots with indices `robots` (R,), without load."""
        self._load[robots] = 0.0

    def sense(self, load: Array) -> None:
        """Set the tractions per unit load (N, 2) [-], limited to MAX_LOAD."""
        self._load = np.clip(load, -MAX_LOAD, MAX_LOAD)

    def law(self) -> IcrLoad:
        """The law at the load that was last sensed."""
        return self._known.under(self._load)

    def velocity(self, omega: Array, geometry: RobotGeometry) -> Array:
        """Velocities (N, 3), including those to the left under load, at sprocket speeds (N, 2)."""
        velocity = super().velocity(omega, geometry)
        velocity[:, 1] = self.law().sideslip(velocity[:, ::2])
        return velocity

    def odometry(self, geometry: RobotGeometry) -> SlipOdometry | None:
        """Odometry by the law at the last load, if its errors are known."""
        odometry = _odometry(self._identified)
        if odometry is not None:
            odometry.use(self.law(), odometry.errors)
        return odometry

    def crab_angle(self, twist: Array, drift: Array | float = 0.0) -> Array:
        """Angles (N,) from headings left to directions of motion [rad], at twists (N, 2).

        `drift` (N,) is added to the leftward speed [m/s]. Angles are limited to MAX_CRAB_ANGLE.
        """
        forward = twist[:, 0]
        leftward = self.law().sideslip(twist) + drift
        angle = np.arctan2(leftward * np.sign(forward), np.abs(forward))
        return np.asarray(np.clip(angle, -MAX_CRAB_ANGLE, MAX_CRAB_ANGLE))


def known_law(law: SlipLaw, identified: LawInUse | None = None) -> FixedLaw | LoadedLaw:
    """Build the compensation by a known law, which for an IcrLoad law uses the measured load.

    `identified` is the same law with its errors, if these are known.
    """
    if isinstance(law, IcrLoad):
        return LoadedLaw(law, identified)
    return FixedLaw(law, identified)


def _odometry(identified: LawInUse | None) -> SlipOdometry | None:
    """Odometry by an identified law; None if the errors of its parameters are unknown."""
    if identified is None or identified.errors is None or not identified.errors.names:
        return None
    return identified.odometry()


@checks_arguments
class OnlineIcr(Compensation, Restorable):
    """Compensation by constant ICRs that an `IcrFilter` learns while driving."""

    STATE: ClassVar[tuple[str, ...]] = ("_started",)

    def __init__(
        self,
        geometry: RobotGeometry,
        prior: ConstantIcr | None = None,
        tuning: FilterTuning | None = None,
    ) -> None:
        """Learn from the law `prior`, or from no knowledge."""
        self._geometry = geometry
        self._prior = prior
        self._tuning = tuning
        self._started: IcrFilter | None = None

    def reset(self, start: Array) -> None:
        """Start a new run at poses (N, 3)."""
        self._started = IcrFilter(start, self._geometry, self._prior, self._tuning)

    def restart(self, robots: np.ndarray, start: Array) -> None:
        """Start new runs for the robots with indices `robots` (R,), at poses (R, 3)."""
        self._filter.start(robots, start)

    def observe(self, omega: Array, duration: float, estimate: PoseEstimate) -> None:
        """Update the filter by mean sprocket speeds (N, 2) [rad/s] and the poses afterwards."""
        self._filter.update(omega, duration, estimate)

    def law(self) -> ConstantIcr | IcrLoad:
        """The law with the current estimates, whose parameters are (N,)."""
        return self._filter.law

    def velocity(self, omega: Array, geometry: RobotGeometry) -> Array:
        """Velocities (N, 3) at sprocket speeds (N, 2), with the learnt turning centres."""
        return self._filter.velocity(omega)

    def odometry(self, geometry: RobotGeometry) -> SlipOdometry | None:
        """Odometry by the current law, with the errors of its estimates."""
        return SlipOdometry(self.law(), geometry, errors=self._filter.law_errors)

    @property
    def _filter(self) -> IcrFilter:
        if self._started is None:
            raise TrackslipError("compensation: call reset() before the first run")
        return self._started


@checks_arguments
class LoadedOnlineIcr(OnlineIcr):
    """Compensation by ICRs and turning centres learnt while driving, plus known slip under load."""

    STATE = ("_started", "_loaded")

    def __init__(
        self, geometry: RobotGeometry, prior: IcrLoad, tuning: FilterTuning | None = None
    ) -> None:
        super().__init__(geometry, prior.unloaded_law, tuning or _LOADED_TUNING)
        self._loaded = LoadedLaw(prior)

    def reset(self, start: Array) -> None:
        """Start a new run at poses (N, 3), without load."""
        super().reset(start)
        self._loaded.reset(start)

    def restart(self, robots: np.ndarray, start: Array) -> None:
        """Start new runs for robots with indices `robots` (R,) at poses (R, 3), without load."""
        super().restart(robots, start)
        self._loaded.restart(robots, start)

    def sense(self, load: Array) -> None:
        """Set the tractions per unit load (N, 2) [-]."""
        self._loaded.sense(load)

    def crab_angle(self, twist: Array) -> Array:
        """Angles (N,) from headings left to directions of motion [rad], at twists (N, 2).

        A turning centre ahead of the robot's centre makes the latter drift at -c w.
        """
        centre = self._filter.state[:, 5]
        return self._loaded.crab_angle(twist, drift=-centre * twist[:, 1])

    def observe(self, omega: Array, duration: float, estimate: PoseEstimate) -> None:
        """Update the filter like OnlineIcr, taking the slip under the last sensed load as known."""
        slip_velocity = self.law().yielding(omega, self._geometry)
        self._filter.update(omega, duration, estimate, slip_velocity)

    def law(self) -> IcrLoad:
        """The law with the current estimates, parameters (N,), at the last sensed load."""
        learnt = self._filter.law
        return replace(self._loaded.law(), offset=learnt.offset, radius_error=learnt.radius_error)

    def velocity(self, omega: Array, geometry: RobotGeometry) -> Array:
        """Velocities (N, 3) at sprocket speeds (N, 2), with what the last sensed load adds."""
        return super().velocity(omega, geometry) + self.law().yielding(omega, geometry)


def named_compensation(name: str, robot: RobotGeometry, laws: str | Path = SHIPPED) -> Compensation:
    """Build a compensation from its name and the laws in a file, by default the package's file.

    Raises InvalidValueError for an unknown name, LogError for a file that can't be read or is for
    another robot.
    """
    if name in KNOWN_LAWS:
        return FixedLaw(KNOWN_LAWS[name])
    if name == "online_cold":
        return OnlineIcr(robot)
    from trackslip.odometry.identified import identified_law  # late, as it takes a while

    stored = load_laws(laws, robot)
    prior = stored.get(_PRIORS.get(name, ""))
    if isinstance(prior, ConstantIcr):
        return OnlineIcr(robot, prior)
    if isinstance(prior, IcrLoad):
        return LoadedOnlineIcr(robot, prior)
    if name not in stored:
        learning = [online for online, law in _PRIORS.items() if law in stored]
        names = [*KNOWN_LAWS, *stored, *learning, "online_cold"]
        raise InvalidValueError("compensation", name, one_of(names, name))
    return known_law(stored[name], identified_law(laws, name, robot))
