"""Compensation of slip: the one place where a twist becomes sprocket speeds, with or without a law of slip."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

from trackslip.errors import TrackslipError
from trackslip.kinematics import Array, RobotGeometry
from trackslip.localization.base import PoseEstimate
from trackslip.slip.base import SlipLaw
from trackslip.slip.constant import NoSlip
from trackslip.slip.icr import ConstantIcr
from trackslip.slip.online import FilterTuning, IcrFilter


class Compensation(Protocol):
    """Knows, or learns, how N robots slip."""

    def reset(self, start: Array) -> None:
        """A new run begins, at poses (N, 3)."""
        ...

    def observe(self, omega: Array, duration: float, estimate: PoseEstimate) -> None:
        """Sprockets ran at mean speeds (N, 2) [rad/s] for `duration` [s]; then these N poses were measured."""
        ...

    def law(self) -> SlipLaw:
        """The slip law in use now, of each robot where they differ."""
        ...


@dataclass(frozen=True)
class FixedLaw:
    """One law for all robots, as it was identified; without one the tracks are taken not to slip."""

    known: SlipLaw = field(default_factory=NoSlip)

    def reset(self, start: Array) -> None:
        """Nothing to forget."""

    def observe(self, omega: Array, duration: float, estimate: PoseEstimate) -> None:
        """Nothing to learn."""

    def law(self) -> SlipLaw:
        """The law."""
        return self.known


class OnlineIcr:
    """Constant ICRs, found while driving (see `estimation`), beginning with those of `prior`, or with nothing."""

    def __init__(
        self, geometry: RobotGeometry, prior: ConstantIcr | None = None, tuning: FilterTuning | None = None
    ) -> None:
        self._geometry, self._prior, self._tuning = geometry, prior, tuning
        self._filter: IcrFilter | None = None

    def reset(self, start: Array) -> None:
        """A new run begins, at poses (N, 3)."""
        self._filter = IcrFilter(start, self._geometry, self._prior, self._tuning)

    def observe(self, omega: Array, duration: float, estimate: PoseEstimate) -> None:
        """Learn from what the robots drove."""
        self._running.update(omega, duration, estimate)

    def law(self) -> ConstantIcr:
        """The laws found so far, their parameters (N,)."""
        return self._running.law

    @property
    def _running(self) -> IcrFilter:
        if self._filter is None:
            raise TrackslipError("compensation: reset() comes before the first run")
        return self._filter
