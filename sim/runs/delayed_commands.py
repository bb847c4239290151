"""Set points on their way from a controller to the servos of a fleet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.fleet.fleet import Fleet
from trackslip.kinematics import Array


class DelayedCommands:
    """Set points that take effect a while after they are sent, as after a controller's computing
    time.

    Servos read their set points at the beginning of each servo period, so delays are rounded to
    whole periods. No set point overtakes an earlier one.
    """

    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet
        self._now = 0  # number of servo periods simulated so far
        # servo periods in which set points take effect, the robots (R,), and set points (R, 2)
        self._waiting: list[tuple[int, NDArray[np.intp], Array]] = []
        # (N,) servo period in which the last set point of each robot takes effect
        self._last_due = np.zeros(fleet.size, int)

    def send(self, omega: Array, delay: Array | float = 0.0) -> None:
        """Send set points (N, 2) [rad/s], which take effect after `delay`, a scalar or (N,) [s]."""
        periods = np.rint(np.asarray(delay) / self._fleet.period).astype(int)
        due = np.maximum(self._now + periods, self._last_due)
        self._last_due[:] = due
        for period in np.unique(due).tolist():
            robots = np.flatnonzero(self._last_due == period)
            self._waiting.append((period, robots, omega[robots]))
        self._deliver()

    def advance(self, duration: float) -> None:
        """Simulate the fleet for `duration` [s], in which set points take effect on time.

        Afterwards, the fleet's means over its last `advance` are those over `duration`.
        """
        fleet = self._fleet
        total = round(duration / fleet.period)
        end = self._now + total
        sensed = np.zeros_like(fleet.sensed)
        traction = np.zeros_like(fleet.mean_traction)
        parts = 0
        while self._now < end:
            due = min((period for period, _, _ in self._waiting), default=end)
            periods = min(due, end) - self._now
            fleet.advance(duration if periods == total else periods * fleet.period)
            sensed += periods / total * fleet.sensed
            traction += periods / total * fleet.mean_traction
            parts += 1
            self._now += periods
            self._deliver()
        if parts > 1:
            fleet.sensed[...] = sensed
            fleet.mean_traction[...] = traction

    def _deliver(self) -> None:
        """Let the servos have the set points that are due."""
        due = [each for each in self._waiting if each[0] <= self._now]
        if not due:
            return
        self._waiting = [each for each in self._waiting if each[0] > self._now]
        omega = self._fleet.drive.set_point.copy()
        for _, robots, set_points in due:
            omega[robots] = set_points
        self._fleet.command(omega)
