"""Slip compensation: the law that converts twists into sprocket speeds, fixed or learnt while driving."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from trackslip.errors import InvalidValueError, TrackslipError
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.base import NoSlip, SlipLaw
from trackslip.laws.exponential import PUBLISHED
from trackslip.laws.file import SHIPPED, load_laws
from trackslip.laws.icr import MAX_LOAD, ConstantIcr, IcrLoad
from trackslip.localization.scan import PoseEstimate
from trackslip.online.filter import FilterTuning, IcrFilter

KNOWN_LAWS: Mapping[str, SlipLaw] = {"none": NoSlip(), "published": PUBLISHED}
"""The paper's compensations, slip laws that need no identification."""
MAX_CRAB_ANGLE = 0.3
"""Largest angle between the heading of a robot and its direction of motion [rad]."""
_LOADED_TUNING = FilterTuning(centre_spread=0.2, centre_walk=0.01)
"""Laws under load do not model how the turning centre shifts along a robot that turns towards the slope."""


class Compensation(Protocol):
    """Provides the slip laws of N robots; by default it learns nothing from runs."""

    def reset(self, start: Array) -> None:
        """Start a new run at poses (N, 3)."""
        return

    def restart(self, robots: np.ndarray, start: Array) -> None:
        """Start new runs for some of the robots (R,), at poses (R, 3)."""
        return

    def observe(self, omega: Array, duration: float, estimate: PoseEstimate) -> None:
        """Take the mean sprocket speeds (N, 2) [rad/s] over `duration` [s] and the N poses measured afterwards."""
        return

    @abstractmethod
    def law(self) -> SlipLaw:
        """The current slip law, with one set of parameters per robot where they differ."""


@runtime_checkable
class SensesLoad(Protocol):
    """A compensation that also takes the traction per unit load of the robots, for example from their inclination."""

    def sense(self, load: Array) -> None:
        """Take tractions per unit load (N, 2), along the robots and to their left [-], before each call of `law`."""

    def crab_angle(self, twist: Array) -> Array:
        """Angles (N,) from the robots' headings to their directions of motion at twists (N, 2), left positive [rad]."""


@dataclass(frozen=True)
class FixedLaw(Compensation):
    """A fixed law for all robots; by default no slip, which means no compensation."""

    known: SlipLaw = field(default_factory=NoSlip)

    def law(self) -> SlipLaw:
        """The law."""
        return self.known


class LoadedLaw(Compensation):
    """A fixed law of slip under load, evaluated at the measured load."""

    def __init__(self, known: IcrLoad) -> None:
        self._known = known

    def reset(self, start: Array) -> None:
        """Start a new run at poses (N, 3), without load."""
        self._load: Array = np.zeros((len(start), 2))

    def restart(self, robots: np.ndarray, start: Array) -> None:
        """Start new runs for some of the robots (R,), without load."""
        self._load[robots] = 0.0

    def sense(self, load: Array) -> None:
        """Take tractions per unit load (N, 2) [-]; larger ones are limited to MAX_LOAD."""
        self._load = np.clip(load, -MAX_LOAD, MAX_LOAD)

    def law(self) -> IcrLoad:
        """The law at the last sensed load."""
        return self._known.under(self._load)

    def crab_angle(self, twist: Array, drift: Array | float = 0.0) -> Array:
        """Angles (N,) from the robots' headings to their directions of motion at twists (N, 2), left positive [rad].

        `drift` (N,) is added to the leftward speed [m/s]. Angles are limited to MAX_CRAB_ANGLE.
        """
        forward, leftward = twist[:, 0], self.law().sideslip(twist) + drift
        angle = np.arctan2(leftward * np.sign(forward), np.abs(forward))
        return np.asarray(np.clip(angle, -MAX_CRAB_ANGLE, MAX_CRAB_ANGLE))


def known_law(law: SlipLaw) -> FixedLaw | LoadedLaw:
    """Compensation by a known law; a law of slip under load uses the measured load."""
    return LoadedLaw(law) if isinstance(law, IcrLoad) else FixedLaw(law)


class OnlineIcr(Compensation):
    """Constant ICRs learnt while driving by an `IcrFilter`, starting from `prior` or without prior knowledge."""

    def __init__(
        self, geometry: RobotGeometry, prior: ConstantIcr | None = None, tuning: FilterTuning | None = None
    ) -> None:
        self._geometry, self._prior, self._tuning = geometry, prior, tuning
        self._started: IcrFilter | None = None

    def reset(self, start: Array) -> None:
        """Start a new run at poses (N, 3)."""
        self._started = IcrFilter(start, self._geometry, self._prior, self._tuning)

    def restart(self, robots: np.ndarray, start: Array) -> None:
        """Start new runs for some of the robots (R,), at poses (R, 3)."""
        self._filter.start(robots, start)

    def observe(self, omega: Array, duration: float, estimate: PoseEstimate) -> None:
        """Update the filters with the motion of the robots."""
        self._filter.update(omega, duration, estimate)

    def law(self) -> ConstantIcr | IcrLoad:
        """The current estimates, with parameters (N,)."""
        return self._filter.law

    @property
    def _filter(self) -> IcrFilter:
        if self._started is None:
            raise TrackslipError("compensation: call reset() before the first run")
        return self._started


class LoadedOnlineIcr(OnlineIcr):
    """Constant ICRs and the turning centre learnt while driving, plus slip under load from a known law."""

    def __init__(self, geometry: RobotGeometry, prior: IcrLoad, tuning: FilterTuning | None = None) -> None:
        super().__init__(geometry, prior.unloaded_law, tuning or _LOADED_TUNING)
        self._loaded = LoadedLaw(prior)

    def reset(self, start: Array) -> None:
        """Start a new run at poses (N, 3), without load."""
        super().reset(start)
        self._loaded.reset(start)

    def restart(self, robots: np.ndarray, start: Array) -> None:
        """Start new runs for some of the robots (R,), at poses (R, 3), without load."""
        super().restart(robots, start)
        self._loaded.restart(robots, start)

    def sense(self, load: Array) -> None:
        """Take tractions per unit load (N, 2) [-]."""
        self._loaded.sense(load)

    def crab_angle(self, twist: Array) -> Array:
        """Angles (N,) from the robots' headings to their directions of motion at twists (N, 2), left positive [rad]."""
        return self._loaded.crab_angle(twist, drift=-self._filter.state[:, 5] * twist[:, 1])

    def observe(self, omega: Array, duration: float, estimate: PoseEstimate) -> None:
        """Update the filters with the robots' motion, during which tracks slipped under the last sensed load."""
        self._filter.update(omega, duration, estimate, self.law().yielding(omega, self._geometry))

    def law(self) -> IcrLoad:
        """The current estimates, with parameters (N,), at the last sensed load."""
        learnt = self._filter.law
        return replace(self._loaded.law(), offset=learnt.offset, radius_error=learnt.radius_error)


_PRIORS = {"online": "icr_radius", "online_load": "icr_load"}  # the laws from which learning starts


def named_compensation(name: str, robot: RobotGeometry, laws: str | Path = SHIPPED) -> Compensation:
    """A new compensation by name, using the laws in a file (default: those in the package).

    Raises InvalidValueError for an unknown name, LogError for a file that can't be read or is for another robot.
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
