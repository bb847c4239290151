"""Pilot: a controller of some robots of a fleet, and the slip compensation of its twists."""

from __future__ import annotations

import traceback
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from sim.run_recorder import RunRecorder
from trackslip.controllers.base import Controller, SensesSprockets
from trackslip.errors import RunFailedError, TrackslipError
from trackslip.kinematics import Array, advance
from trackslip.laws.base import SlipLaw
from trackslip.online.compensation import Compensation, FixedLaw, SensesLoad
from trackslip.trajectory.base import Reference


@dataclass(frozen=True)
class Pilot:
    """The controller of R robots of a fleet, and their slip compensation."""

    controller: Controller
    robots: Sequence[int]
    compensation: Compensation = field(default_factory=FixedLaw)
    preview: float = 0.0
    """Look-ahead time of the controller: the delay between command and motion [s]."""

    @cached_property
    def _loaded(self) -> SensesLoad | None:
        return self.compensation if isinstance(self.compensation, SensesLoad) else None

    @cached_property
    def _sensing(self) -> SensesSprockets | None:
        return self.controller if isinstance(self.controller, SensesSprockets) else None

    def begin(self, record: RunRecorder) -> None:
        """Begin new runs at the robots' current poses, recorded by `record`."""
        self.controller.reset()
        self.compensation.reset(record.fleet.pose()[self.robots])
        if self._loaded is not None:
            record.sense_loads()

    def law(self, record: RunRecorder, k: int) -> SlipLaw:
        """Slip law in row k, after the compensation has observed the motion so far."""
        if k > 0:
            self.compensation.observe(record.omega[k, self.robots], record.period, record.estimated(k, self.robots))
        if self._loaded is not None:
            self._loaded.sense(record.load[k, self.robots])
        law = self.compensation.law()
        record.compensated(k, self.robots, law)
        return law

    def twist(self, record: RunRecorder, k: int, law: SlipLaw, reference: Reference) -> Array:
        """Twists (R, 2) that the controller wants in row k; raises RunFailedError when it fails."""
        pose: Array = record.pose[k, self.robots]
        omega, time = record.omega[k, self.robots], float(record.time[k])
        geometry = record.fleet.robot.geometry
        # which way the robots move, and where they will be when the command takes effect
        if self._loaded is not None:
            pose[:, 2] += self._loaded.crab_angle(law.twist(omega, geometry))
        if self.preview > 0:
            pose = advance(pose, law.twist(omega, geometry), self.preview)
        try:
            if self._sensing is not None:
                self._sensing.sense(omega)
            twist = np.asarray(self.controller.twist(time + self.preview, pose, reference), dtype=float)
        except TrackslipError as error:
            raise RunFailedError(str(error)) from error
        except Exception as error:  # whatever a user's controller does
            frames = traceback.extract_tb(error.__traceback__)[1:]  # without the call itself
            where = f", {Path(frames[0].filename).name} line {frames[0].lineno}" if frames else ""
            what = f"its controller fails at {time:g} s ({type(error).__name__}: {error}){where}"
            raise RunFailedError(f"run {record.name(self.robots[0])!r}: {what}") from error
        record.wanted(k, self.robots, twist)
        return twist
