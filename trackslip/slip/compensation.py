"""Slip compensation: which law converts twists into sprocket speeds, fixed or learnt while driving."""

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
    """Provides the slip laws of N robots."""

    def reset(self, start: Array) -> None:
        """Start a new run at poses (N, 3)."""

    def observe(self, omega: Array, duration: float, estimate: PoseEstimate) -> None:
        """Take the mean sprocket speeds (N, 2) [rad/s] over `duration` [s] and the N poses measured afterwards."""

    def law(self) -> SlipLaw:
        """The current slip law, with one set of parameters per robot where they differ."""


@dataclass(frozen=True)
class FixedLaw:
    """A fixed law for all robots; by default no slip, which means no compensation."""

    known: SlipLaw = field(default_factory=NoSlip)

    def reset(self, start: Array) -> None:
        """Nothing to reset."""

    def observe(self, omega: Array, duration: float, estimate: PoseEstimate) -> None:
        """Nothing to learn."""

    def law(self) -> SlipLaw:
        """The law."""
        return self.known


class OnlineIcr:
    """Constant ICRs, learnt while driving by an `IcrFilter`, from those of `prior` or without prior knowledge."""

    def __init__(
        self, geometry: RobotGeometry, prior: ConstantIcr | None = None, tuning: FilterTuning | None = None
    ) -> None:
        self._geometry, self._prior, self._tuning = geometry, prior, tuning
        self._filter: IcrFilter | None = None

    def reset(self, start: Array) -> None:
        """Start a new run at poses (N, 3)."""
        self._filter = IcrFilter(start, self._geometry, self._prior, self._tuning)

    def observe(self, omega: Array, duration: float, estimate: PoseEstimate) -> None:
        """Update the filters with the motion of the robots."""
        self._running.update(omega, duration, estimate)

    def law(self) -> ConstantIcr:
        """The current estimates, with parameters (N,)."""
        return self._running.law

    @property
    def _running(self) -> IcrFilter:
        if self._filter is None:
            raise TrackslipError("compensation: call reset() before the first run")
        return self._filter
