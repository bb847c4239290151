"""From estimated poses to sprocket speeds: the pilots of a fleet."""

from __future__ import annotations

import traceback
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sim.run_recorder import RunRecorder
from trackslip.controllers.base import Controller, SensesSprockets
from trackslip.errors import RunFailedError, TrackslipError
from trackslip.kinematics import Array, RobotGeometry, advance
from trackslip.slip.compensation import Compensation, FixedLaw, SensesLoad
from trackslip.trajectory.base import Reference
from trackslip.trajectory.tabulated import Tabulated


@dataclass(frozen=True)
class Pilot:
    """The controller of some robots of a fleet, and what converts its twists into sprocket speeds."""

    controller: Controller
    robots: Sequence[int]
    compensation: Compensation = field(default_factory=FixedLaw)
    preview: float = 0.0
    """How far ahead the controller looks: set it to the delay between command and motion [s]."""


class Steering:
    """The pilots of N robots on the way along a reference."""

    def __init__(
        self, pilots: Sequence[Pilot], start: Array, record: RunRecorder, reference: Reference, geometry: RobotGeometry
    ) -> None:
        """Begin new runs at the poses `start` (N, 3), with the row of `record` in which the robots are measured."""
        for pilot in pilots:
            pilot.controller.reset()
            pilot.compensation.reset(start[pilot.robots])
            if isinstance(pilot.compensation, SensesLoad):
                record.sense_loads()
        tables = {ahead: Tabulated(reference, record.time + ahead) for ahead in {pilot.preview for pilot in pilots}}
        self._pilots = [(pilot, np.asarray(pilot.robots, int), tables[pilot.preview]) for pilot in pilots]
        self._record, self._geometry = record, geometry
        self._wanted, self._omega = np.zeros((2, len(start), 2))

    def omega(self, k: int, period: float) -> Array:
        """Sprocket speeds (N, 2) [rad/s] that the pilots command in row k, `period` [s] after the one before.

        Raises RunFailedError when a controller fails.
        """
        record, geometry = self._record, self._geometry
        for pilot, robots, reference in self._pilots:
            compensation, pose, omega = pilot.compensation, record.pose[k, robots], record.omega[k, robots]
            loaded = compensation if isinstance(compensation, SensesLoad) else None
            # the present slip law
            if k > 0:
                compensation.observe(omega, period, record.estimated(k, robots))
            if loaded is not None:
                loaded.sense(record.load[k, robots])
            law = compensation.law()
            record.compensated(k, robots, law)
            # where the robots will be when the command takes effect, and which way they move
            if loaded is not None:
                pose[:, 2] += loaded.crab_angle(law.twist(omega, geometry))
            if pilot.preview > 0:
                pose = advance(pose, law.twist(omega, geometry), pilot.preview)
            self._wanted[robots] = twist = self._twist(k, pilot, robots, reference, pose, omega)
            self._omega[robots] = law.sprocket_speeds(twist, geometry)
        record.wanted(k, self._wanted)
        return self._omega

    def _twist(
        self, k: int, pilot: Pilot, robots: np.ndarray, reference: Reference, pose: Array, omega: Array
    ) -> Array:
        """Twists (R, 2) that a controller wants in row k for its robots at poses (R, 3)."""
        record = self._record
        try:
            if isinstance(pilot.controller, SensesSprockets):
                pilot.controller.sense(omega)
            wanted = pilot.controller.twist(float(record.time[k]) + pilot.preview, pose, reference)
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
