"""The bare engine in exactly the motion of a fleet: its belts change their speeds in every servo period, too.

Belts at constant speeds would be cheaper physics than the fleet's: as long as nothing changes, the solver starts from
its solution.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np

from experiments.speed.simulator import bare_batch
from sim.fleet import Fleet
from trackslip.kinematics import Array


class SameMotion:
    """The bare engine, which repeats what a fleet did since the last repetition."""

    def __init__(self, fleet: Fleet, duration: float) -> None:
        """Repeat `duration` [s] at a time, a multiple of the servo period."""
        self._fleet = fleet
        self._periods = round(duration / fleet.period)
        self._substeps = round(fleet.period / fleet.robot.model.opt.timestep)
        self._bare = bare_batch(fleet)
        self._surface = self._bare.expand("geom_surfacevel")[:, fleet.robot.pads, 2]  # live
        self._friction = self._bare.expand("pair_friction")  # live
        self.begin()

    def begin(self) -> None:
        """Note the present state of the fleet, from which the next repetition starts."""
        fleet = self._fleet
        self._bare.state[:] = fleet.batch.state
        self._friction[:] = fleet.batch.expand("pair_friction")
        self._drive = fleet.drive.of(np.arange(fleet.size))

    def repeat(self) -> float:
        """Time that the bare engine takes to drive on from there by the fleet's present set points [s]."""
        belts = self._belts()
        began = perf_counter()
        for of_period in belts:
            self._surface[:] = of_period
            self._bare.step(nstep=self._substeps)
        return perf_counter() - began

    def _belts(self) -> Array:
        """Speeds (P, N, pads) of the pads' surfaces in the servo periods to repeat [m/s]."""
        robot, drive = self._fleet.robot, self._drive
        drive.command(self._fleet.drive.set_point)
        return (-drive.radius * drive.forecast(self._periods).mean).take(robot.pad_side, axis=-1) * robot.pad_sign
