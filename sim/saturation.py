"""The speed that a motor at its limit can hold."""

from __future__ import annotations

import numpy as np

from sim.drive import DriveState, Forecast
from trackslip.kinematics import Array

_ATTEMPTS = 12
_TOLERANCE = 0.01  # of the torque at the limit, relative to the largest torque
_STIFFNESS = 10.0  # first guess of the torque that a change of speed takes [N m s/rad]


class SpeedSearch:
    """Finds, for one servo period, speeds at which the torques are within the motors' limits.

    Where following the servo takes too much torque, the speed at the period's end is the unknown of
    torque(speed) = limit(speed), solved by the secant method inside a bracket; the belt runs at that speed all through
    the period, so that however stiff the grip nothing rings. Every robot's search depends on itself only.
    """

    def __init__(self, drive: DriveState) -> None:
        """Try what the servo wants first."""
        self._drive = drive
        self._wanted = drive.forecast(1)
        self.trial = self._wanted
        """What to try next; when done, what comes true."""
        self.torque: Array = np.zeros((1, *drive.omega.shape))
        """Torques (1, N, 2) of the last trial, within the limits [N m]."""
        self._side = np.zeros(drive.omega.shape)  # of the limit that is reached: 1, -1, or 0 for none
        self._slope = np.full(drive.omega.shape, _STIFFNESS)
        self._last: tuple[Array, Array] | None = None
        self._too_slow = np.full(drive.omega.shape, -np.inf)  # in the direction of side: there is torque left
        self._too_fast = np.full(drive.omega.shape, np.inf)
        self._attempts = 0

    @property
    def saturated(self) -> np.ndarray:
        """(1, N, 2) whether each motor is at its limit."""
        return (self._side != 0)[None]

    def done(self, torque: Array) -> bool:
        """Take the torques (1, N, 2) [N m] that the trial took; False if another trial is needed."""
        drive = self._drive
        least, most = drive.torque_range(self.trial.omega[1:])
        self.torque = np.clip(torque, least, most)
        new = (self._side == 0) & (torque != self.torque)[0]
        self._side = np.where(new, np.sign(torque - self.torque)[0], self._side)
        speed = self.trial.omega[1]
        # all in the direction of the limit: excess > 0 is too fast
        excess = self._side * (torque - np.where(self._side > 0, most, least))[0]
        at_wanted = self._side * (self._wanted.omega[1] - speed) <= 0
        settled = (self._side == 0) | (np.abs(excess) <= _TOLERANCE * drive.torque_limit) | (at_wanted & (excess < 0))
        self._attempts += 1
        open_robots = ~settled.all(axis=1, keepdims=True)
        if not open_robots.any() or self._attempts == _ATTEMPTS:
            return True
        self._next(speed, excess, open_robots & (self._side != 0))
        return False

    def _next(self, speed: Array, excess: Array, moving: np.ndarray) -> None:
        """Another trial for the tracks (N, 2) that are moving in the search."""
        fast = self._side * speed
        self._too_fast = np.where(moving & (excess > 0), np.minimum(self._too_fast, fast), self._too_fast)
        self._too_slow = np.where(moving & (excess < 0), np.maximum(self._too_slow, fast), self._too_slow)
        if self._last is not None:
            d_speed, d_excess = fast - self._last[0], excess - self._last[1]
            known = moving & (d_speed * d_excess > 0)
            self._slope = np.where(known, d_excess / np.where(known, d_speed, 1.0), self._slope)
        self._last = fast, excess
        guess = fast - excess / self._slope
        outside = (guess <= self._too_slow) | (guess >= self._too_fast)
        bracketed = np.isfinite(self._too_slow) & np.isfinite(self._too_fast)
        middle = (np.where(bracketed, self._too_slow, 0.0) + np.where(bracketed, self._too_fast, 0.0)) / 2
        guess = np.where(outside & bracketed, middle, guess)
        wanted = self._wanted
        guess = np.minimum(guess, self._side * wanted.omega[1])
        trial = np.where(moving, self._side * guess, speed)
        not_faster = self._side * np.minimum(self._side * trial, self._side * wanted.mean[0])
        mean = np.where(self._side != 0, not_faster, wanted.mean[0])
        self.trial = Forecast(np.stack([wanted.omega[0], trial]), mean[None])
