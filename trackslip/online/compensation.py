"""Slip compensation by a law that converts twists into sprocket speeds, fixed or learnt while
driving.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from trackslip.errors import InvalidValueError, TrackslipError
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.base import NoSlip, SlipLaw
from trackslip.laws.exponential import PUBLISHED
from trackslip.laws.file import SHIPPED, load_laws
from trackslip.laws.icr import MAX_LOAD, ConstantIcr, IcrLoad
from trackslip.localization.scan import PoseEstimate
from trackslip.online.filter import FilterTuning, IcrFilter
from trackslip.restorable import Restorable

KNOWN_LAWS: Mapping[str, SlipLaw] = {"none": NoSlip(), "published": PUBLISHED}
"""The laws with which the paper compensates slip, which need no identification."""
MAX_CRAB_ANGLE = 0.3
"""Maximum angle between a robot's heading and its direction of motion [rad]."""
_LOADED_TUNING = FilterTuning(centre_spread=0.2, centre_walk=0.01)
"""Tuning for laws under load, which do not model how the turning centre moves along a robot that
turns on a slope.
"""


class Compensation(Protocol):
    """Provider of the current slip laws of N robots. By default, the laws are not updated during
    runs.
    """

    def reset(self, start: Array) -> None:
        """Start a new run at poses (N, 3)."""
        return

    def restart(self, robots: np.ndarray, start: Array) -> None:
        """Start new runs for the robots with indices `robots` (R,), at poses (R, 3)."""
        return

    def observe(self, omega: Array, duration: float, estimate: PoseEstimate) -> None:
        """Process mean sprocket speeds (N, 2) [rad/s] over `duration` [s] and the N poses measured
        afterwards.
        """
        return

    @abstractmethod
    def law(self) -> SlipLaw:
        """The current slip law, with separate parameters for each robot where they differ."""


@runtime_checkable
class SensesLoad(Protocol):
    """A compensation that also uses the robots' traction per unit load, for example from their
    inclination.
    """

    def sense(self, load: Array) -> None:
        """Set the tractions per unit load (N, 2), along the robots and to their left [-], before
        each call of `law`.
        """

    def crab_angle(self, twist: Array) -> Array:
        """Angles (N,) from headings to directions of motion at twists (N, 2), positive to the left
        [rad].
        """


@dataclass(frozen=True)
class FixedLaw(Compensation, Restorable):
    """Compensation by a fixed law for all robots, by default the law without slip, which means no
    compensation.
    """

    known: SlipLaw = field(default_factory=NoSlip)

    def law(self) -> SlipLaw:
        """The fixed law."""
        return self.known


class LoadedLaw(Compensation, Restorable):
    """Compensation by a fixed law of slip under load, evaluated at the measured load."""

    STATE = ("_load",)

    def __init__(self, known: IcrLoad) -> None:
        self._known = known

    def reset(self, start: Array) -> None:
        """Start a new run at poses (N, 3), without load."""
        self._load: Array = np.zeros((len(start), 2))

    def restart(self, robots: np.ndarray, start: Array) -> None:
        """Start new runs for the robots with indices `robots` (R,), without load."""
        self._load[robots] = 0.0

    def sense(self, load: Array) -> None:
        """Set the tractions per unit load (N, 2) [-], limited to MAX_LOAD."""
        self._load = np.clip(load, -MAX_LOAD, MAX_LOAD)

    def law(self) -> IcrLoad:
        """The law at the load that was last sensed."""
        return self._known.under(self._load)

    def crab_angle(self, twist: Array, drift: Array | float = 0.0) -> Array:
        """Angles (N,) from headings to directions of motion at twists (N, 2), positive to the left
        [rad].

        `drift` (N,) is added to the leftward speed [m/s]. Angles are limited to MAX_CRAB_ANGLE.
        """
        forward, leftward = twist[:, 0], self.law().sideslip(twist) + drift
        angle = np.arctan2(leftward * np.sign(forward), np.abs(forward))
        return np.asarray(np.clip(angle, -MAX_CRAB_ANGLE, MAX_CRAB_ANGLE))


def known_law(law: SlipLaw) -> FixedLaw | LoadedLaw:
    """Build the compensation by a known law, which for an IcrLoad law uses the measured load."""
    return LoadedLaw(law) if isinstance(law, IcrLoad) else FixedLaw(law)


class OnlineIcr(Compensation, Restorable):
    """Compensation by constant ICRs that an `IcrFilter` learns while driving, from `prior` or from
    no knowledge.
    """

    STATE: ClassVar[tuple[str, ...]] = ("_started",)

    def __init__(
        self,
        geometry: RobotGeometry,
        prior: ConstantIcr | None = None,
        tuning: FilterTuning | None = None,
    ) -> None:
        self._geometry, self._prior, self._tuning = geometry, prior, tuning
        self._started: IcrFilter | None = None

    def reset(self, start: Array) -> None:
        """Start a new run at poses (N, 3)."""
        self._started = IcrFilter(start, self._geometry, self._prior, self._tuning)

    def restart(self, robots: np.ndarray, start: Array) -> None:
        """Start new runs for the robots with indices `robots` (R,), at poses (R, 3)."""
        self._filter.start(robots, start)

    def observe(self, omega: Array, duration: float, estimate: PoseEstimate) -> None:
        """Update the filter with mean sprocket speeds (N, 2) [rad/s] over `duration` [s] and the
        poses afterwards.
        """
        self._filter.update(omega, duration, estimate)

    def law(self) -> ConstantIcr | IcrLoad:
        """The law with the current estimates, whose parameters are (N,)."""
        return self._filter.law

    @property
    def _filter(self) -> IcrFilter:
        if self._started is None:
            raise TrackslipError("compensation: call reset() before the first run")
        return self._started


class LoadedOnlineIcr(OnlineIcr):
    """Compensation by constant ICRs and turning centres learnt while driving, plus slip under load
    from a known law.
    """

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
        """Start new runs for the robots with indices `robots` (R,), at poses (R, 3), without
        load.
        """
        super().restart(robots, start)
        self._loaded.restart(robots, start)

    def sense(self, load: Array) -> None:
        """Set the tractions per unit load (N, 2) [-]."""
        self._loaded.sense(load)

    def crab_angle(self, twist: Array) -> Array:
        """Angles (N,) from headings to directions of motion at twists (N, 2), positive to the left
        [rad].
        """
        return self._loaded.crab_angle(twist, drift=-self._filter.state[:, 5] * twist[:, 1])

    def observe(self, omega: Array, duration: float, estimate: PoseEstimate) -> None:
        """Update the filter like OnlineIcr, taking the slip under the last sensed load as known."""
        self._filter.update(omega, duration, estimate, self.law().yielding(omega, self._geometry))

    def law(self) -> IcrLoad:
        """The law with the current estimates, whose parameters are (N,), at the last sensed
        load.
        """
        learnt = self._filter.law
        return replace(self._loaded.law(), offset=learnt.offset, radius_error=learnt.radius_error)


# laws from which learning starts, by compensation
_PRIORS = {"online": "icr_radius", "online_load": "icr_load"}


def named_compensation(name: str, robot: RobotGeometry, laws: str | Path = SHIPPED) -> Compensation:
    """Build a compensation from its name and the laws in a file, by default the file in the
    package.

    Raises InvalidValueError for an unknown name, LogError for a file that can't be read or is for
    another robot.
    """
    if name in KNOWN_LAWS:
        return FixedLaw(KNOWN_LAWS[name])
    if name == "online_cold":
        return OnlineIcr(robot)
    stored = load_laws(laws, robot)
    prior = stored.get(_PRIORS.get(name, ""))
    if isinstance(prior, ConstantIcr):
        return OnlineIcr(robot, prior)
    if isinstance(prior, IcrLoad):
        return LoadedOnlineIcr(robot, prior)
    if name not in stored:
        learning = [name for name, law in _PRIORS.items() if law in stored]
        allowed = f"one of {', '.join([*KNOWN_LAWS, *stored, *learning, 'online_cold'])}"
        raise InvalidValueError("compensation", name, allowed)
    return known_law(stored[name])
