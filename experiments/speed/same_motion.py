"""The bare engine in exactly the motion of a fleet: its belts change their speeds in every servo period, too.

Belts at constant speeds would be cheaper physics than the fleet's: as long as nothing changes, the solver starts from
its solution.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np
from mujoco import batch

from experiments.speed.simulator import bare_batch, bare_copy
from sim.fleet import Fleet
from trackslip.kinematics import Array


class _BeltSpeeds:
    """The speeds of a fleet's belts, from the present moment on, for some time."""

    def __init__(self, fleet: Fleet, duration: float) -> None:
        """`duration` [s] is a multiple of the servo period."""
        self._fleet = fleet
        self._periods = round(duration / fleet.period)
        self._drive = fleet.drive.of(np.arange(fleet.size))

    def planned(self) -> Array:
        """Speeds (P, N, pads) of the pads' surfaces in the P servo periods [m/s], at the fleet's present set points."""
        robot, drive = self._fleet.robot, self._drive
        drive.command(self._fleet.drive.set_point)
        return (-drive.radius * drive.forecast(self._periods).mean).take(robot.pad_side, axis=-1) * robot.pad_sign


class SameMotion:
    """The bare engine, which repeats what a fleet did since the last repetition."""

    def __init__(self, fleet: Fleet, duration: float) -> None:
        """Repeat `duration` [s] at a time, a multiple of the servo period."""
        self._fleet, self._duration = fleet, duration
        self._bare = bare_batch(fleet)
        self._friction = self._bare.expand("pair_friction")  # live
        self.begin()

    def begin(self) -> None:
        """Note the present state of the fleet, from which the next repetition starts."""
        self._bare.state[:] = self._fleet.batch.state
        self._friction[:] = self._fleet.batch.expand("pair_friction")
        self._belts = _BeltSpeeds(self._fleet, self._duration)

    def repeat(self) -> float:
        """Time that the bare engine takes to drive on from there by the fleet's present set points [s]."""
        return _drive(self._bare, self._fleet, self._belts.planned())


class WholeMotion:
    """All that a fleet does from the present moment on, for the bare engine to repeat again and again."""

    def __init__(self, fleet: Fleet, duration: float) -> None:
        """Note `duration` [s] at a time, a multiple of the servo period."""
        self._fleet, self._duration = fleet, duration
        self._start = bare_batch(fleet)
        self._speeds: list[Array] = []
        self._belts = _BeltSpeeds(fleet, duration)

    def note(self) -> None:
        """Note what the fleet has done since the last call, or since the beginning."""
        self._speeds.append(self._belts.planned())
        self._belts = _BeltSpeeds(self._fleet, self._duration)

    def repeat(self, threads: int) -> float:
        """Time that the bare engine takes for all of it on some threads [s]."""
        return _drive(self.at_start(threads), self._fleet, np.concatenate(self._speeds))

    def at_start(self, threads: int) -> batch.Batch:
        """The bare engine as the fleet was at the beginning."""
        return bare_copy(self._start, threads)


def _drive(bare: batch.Batch, fleet: Fleet, speeds: Array) -> float:
    """Time that the bare engine takes for servo periods in which the pads' surfaces have speeds (P, N, pads) [s]."""
    substeps = round(fleet.period / fleet.robot.model.opt.timestep)
    surface = bare.expand("geom_surfacevel")[:, fleet.robot.pads, 2]  # live
    began = perf_counter()
    for of_period in speeds:
        surface[:] = of_period
        bare.step(nstep=substeps)
    return perf_counter() - began
