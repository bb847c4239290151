"""From estimated poses to sprocket speeds: the pilots of a fleet, evaluated together where they are alike."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sim.run_recorder import RunRecorder
from trackslip.controllers.base import Controller, SensesSprockets
from trackslip.controllers.named import CONTROLLERS
from trackslip.errors import RunFailedError, TrackslipError
from trackslip.kinematics import Array, RobotGeometry, advance
from trackslip.slip.base import SlipLaw
from trackslip.slip.compensation import Compensation, FixedLaw, SensesLoad
from trackslip.trajectory.base import Reference
from trackslip.trajectory.tabulated import Tabulated

_OURS = frozenset(CONTROLLERS.values())


@dataclass(frozen=True)
class Pilot:
    """The controller of some robots of a fleet, and what converts its twists into sprocket speeds."""

    controller: Controller
    robots: Sequence[int]
    compensation: Compensation = field(default_factory=FixedLaw)
    preview: float = 0.0
    """How far ahead the controller looks: set it to the delay between command and motion [s]."""


@dataclass(frozen=True)
class _Steerer:
    """A controller, and all robots that it steers."""

    controller: Controller
    robots: np.ndarray  # (R,)
    preview: float  # [s]
    reference: Tabulated  # at the times of the rows, and so far ahead
    senses: SensesSprockets | None


@dataclass(frozen=True)
class _Compensator:
    """A compensation, and all robots whose twists it converts."""

    compensation: Compensation
    robots: np.ndarray  # (R,)
    preview: float  # [s]
    fixed: SlipLaw | None  # its law, if that never changes
    senses: SensesLoad | None


class Steering:
    """The pilots of N robots on the way along a reference.

    Equal controllers of this package steer their robots in one call, and so do equal fixed laws: rows are bitwise
    independent. A controller from elsewhere is called once for each of its pilots.
    """

    def __init__(
        self, pilots: Sequence[Pilot], start: Array, record: RunRecorder, reference: Reference, geometry: RobotGeometry
    ) -> None:
        """Begin new runs at the poses `start` (N, 3), with the row of `record` in which the robots are measured."""
        for pilot in pilots:
            pilot.controller.reset()
            pilot.compensation.reset(start[pilot.robots])
        tables = {ahead: Tabulated(reference, record.time + ahead) for ahead in {pilot.preview for pilot in pilots}}
        self._record, self._geometry = record, geometry
        self._wanted = np.zeros((len(start), 2))  # twists
        self._omega = np.zeros((len(start), 2))
        self._steerers = [
            _Steerer(
                one.controller,
                robots,
                one.preview,
                tables[one.preview],
                one.controller if isinstance(one.controller, SensesSprockets) else None,
            )
            for one, robots in _merged(pilots, _same_steering)
        ]
        self._compensators = [
            _Compensator(
                one.compensation,
                robots,
                one.preview,
                one.compensation.law() if type(one.compensation) is FixedLaw else None,
                one.compensation if isinstance(one.compensation, SensesLoad) else None,
            )
            for one, robots in _merged(pilots, _same_conversion)
        ]
        for each in self._compensators:
            if each.senses is not None:
                record.sense_loads()
            if each.fixed is not None:
                record.compensated(slice(None), each.robots, each.fixed)

    def omega(self, k: int, period: float) -> Array:
        """Sprocket speeds (N, 2) [rad/s] that the pilots command in row k, `period` [s] after the one before.

        Raises RunFailedError when a controller fails.
        """
        record, geometry = self._record, self._geometry
        pose, omega = record.pose[k].copy(), record.omega[k]
        laws = []
        for one in self._compensators:
            law = self._law(one, k, period) if one.fixed is None else one.fixed
            laws.append(law)
            if one.senses is not None:
                pose[one.robots, 2] += one.senses.crab_angle(law.twist(omega[one.robots], geometry))
            if one.preview > 0:
                driven = law.twist(omega[one.robots], geometry)
                pose[one.robots] = advance(pose[one.robots], driven, one.preview)
        for steerer in self._steerers:
            self._wanted[steerer.robots] = self._twist(steerer, k, pose[steerer.robots], omega)
        record.wanted(k, self._wanted)
        for one, law in zip(self._compensators, laws, strict=True):
            if one.fixed is None:
                record.compensated(k, one.robots, law)
            self._omega[one.robots] = law.sprocket_speeds(self._wanted[one.robots], geometry)
        return self._omega

    def _law(self, one: _Compensator, k: int, period: float) -> SlipLaw:
        """The present slip law of a compensation, which learns from row k before."""
        record, robots = self._record, one.robots
        if k > 0:
            one.compensation.observe(record.omega[k, robots], period, record.estimated(k, robots))
        if one.senses is not None:
            one.senses.sense(record.load[k, robots])
        return one.compensation.law()

    def _twist(self, one: _Steerer, k: int, pose: Array, omega: Array) -> Array:
        """Twists (R, 2) that a controller wants in row k for its robots at poses (R, 3)."""
        record, robots = self._record, one.robots
        try:
            if one.senses is not None:
                one.senses.sense(omega[robots])
            wanted = one.controller.twist(float(record.time[k]) + one.preview, pose, one.reference)
            twist = np.asarray(wanted, dtype=float)
        except TrackslipError as error:
            raise RunFailedError(str(error)) from error
        except Exception as error:  # whatever a user's controller does
            frames = traceback.extract_tb(error.__traceback__)[1:]  # without the call itself
            where = f", {Path(frames[0].filename).name} line {frames[0].lineno}" if frames else ""
            what = f"its controller fails at {record.time[k]:g} s ({type(error).__name__}: {error}){where}"
            raise RunFailedError(f"run {record.name(robots[0])!r}: {what}") from error
        record.require_twists(k, robots, twist)
        return twist


def _merged(pilots: Sequence[Pilot], same: Callable[[Pilot, Pilot], bool]) -> list[tuple[Pilot, np.ndarray]]:
    """The first of all pilots that are the `same`, with the robots (R,) of all of them."""
    groups: list[list[Pilot]] = []
    for pilot in pilots:
        group = next((group for group in groups if same(group[0], pilot)), None)
        groups.append([pilot]) if group is None else group.append(pilot)
    return [(group[0], np.concatenate([np.asarray(one.robots, int) for one in group])) for group in groups]


def _same_steering(a: Pilot, b: Pilot) -> bool:
    """Whether one call of a controller serves both pilots."""
    ours = type(a.controller) is type(b.controller) and type(a.controller) in _OURS
    return ours and a.controller == b.controller and a.preview == b.preview


def _same_conversion(a: Pilot, b: Pilot) -> bool:
    """Whether one law serves both pilots."""
    fixed = type(a.compensation) is FixedLaw and type(b.compensation) is FixedLaw
    return fixed and a.compensation.law() is b.compensation.law() and a.preview == b.preview
