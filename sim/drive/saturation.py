"""The speeds that saturated motors can reach."""

from __future__ import annotations

import numpy as np

from sim.drive.drive import DriveState, Forecast
from sim.drive.modes import COMMON, OPPOSITE, modes, tracks
from trackslip.kinematics import Array

_ATTEMPTS = 40
_TOLERANCE = 0.001  # of a saturated torque, relative to the torque limit
_ROUGHNESS = 0.0002  # noise of the ground's forces, which the engine finds by iteration, relative to the weight
_MAX_ACCELERATION = 3.0  # of a track, on any ground and slope, in units of gravity


class SpeedSearch:
    """Search for the speeds of one servo period at which the torques respect the motors' limits.

    A robot whose motors are strong enough moves as its servos demand. The belts of any other robot run at their
    sprockets' final speeds for the whole period, so that nothing oscillates however stiff the grip, and a sprocket
    whose motor is too weak is slowed down as far as necessary. Slower means less in the direction of the torque. The
    torque that a belt speed requires is found by trying it on the ground.

    With one slow sprocket, the search is along that track. With two, it is along their mean and half their difference,
    which are nearly independent, whereas the tracks are not: until the robot begins to turn, the ground's response to a
    difference is hundreds of times stiffer. The searches of different robots are independent.
    """

    def __init__(self, drive: DriveState, mass: float, gravity: float) -> None:
        """Start from the speeds that the servos demand; a finished search advances `drive` by one period.

        `mass` is that of each robot [kg], `gravity` a magnitude [m/s^2].
        """
        self._drive = drive
        self._wanted = drive.forecast(1)
        self._start, self._goal = self._wanted.omega
        period, inertia = drive.drive.period, drive.drive.motor.inertia
        self._reach = np.abs(self._goal - self._start) + _MAX_ACCELERATION * gravity * period / drive.radius
        self._tolerance = _TOLERANCE * drive.drive.torque_limit + _ROUGHNESS * mass * gravity * drive.radius
        self._speed = self._goal  # (N, 2) of the sprockets at the end of the period
        self._weak = np.zeros((len(self._goal), 1), bool)  # robots that can't move as the servos demand
        self._side = np.zeros(self._goal.shape)  # limit that is reached: 1 upper, -1 lower, 0 none
        self._slowed = np.zeros(self._goal.shape, bool)  # tracks whose speeds are being searched
        self._stiffness = inertia / period + mass * drive.radius**2 * [COMMON, OPPOSITE]  # torque over speed change
        self._roots = _Roots(self._stiffness)
        self._attempts = 0

    @property
    def belt(self) -> Array:
        """Mean sprocket speeds (1, N, 2) [rad/s] to try."""
        return np.where(self._weak, self._speed, self._wanted.mean)

    def done(self, traction: Array) -> bool:
        """Evaluate a trial by its tractions (1, N, 2) [N]; False if another trial is needed."""
        drive, wished = self._drive, self._speed == self._goal
        trial = Forecast(np.stack([self._start, self._speed]), self.belt, self._error())
        torque = drive.torque_for(trial, traction)[0]
        least, most = drive.drive.torque_range(self._speed)
        side: Array = np.where(wished, np.where(torque > most, 1.0, np.where(torque < least, -1.0, 0.0)), self._side)
        slowed = self._slowed & (side == self._side)
        self._side = side
        excess = np.where(side == 0, 0.0, torque - np.where(side > 0, most, least))
        far = np.abs(excess) > self._tolerance
        going = np.any(far, axis=1, keepdims=True)
        self._attempts += 1
        if not going.any() or self._attempts == _ATTEMPTS:
            drive.accept(trial, np.clip(torque, least, most)[None], (side != 0)[None])
            return True
        # finish the tracks being searched before adding others, whose speed may be too high only in this trial
        busy = (far & slowed).any(axis=1, keepdims=True)
        self._next(excess, going, np.where(busy, slowed, side != 0))
        return False

    def _next(self, excess: Array, going: np.ndarray, slowed: np.ndarray) -> None:
        """Choose the next trial, in which the robots `going` (N, 1) have the tracks `slowed` (N, 2) slowed down."""
        both = slowed.all(axis=1, keepdims=True)
        changed = (slowed != self._slowed).any(axis=1, keepdims=True)
        self._slowed = slowed
        self._roots.restart(changed, np.where(both, self._stiffness, self._stiffness.mean(axis=1, keepdims=True)))
        if self._attempts == 1:  # start where the belts turn the robot no faster than before
            self._weak = going
            guess = np.where(both, self._start, self._start + (self._goal - self._start)[:, ::-1])
        else:
            x, f = (np.where(both, modes(each), each) for each in (self._speed, excess))
            guess = self._roots.next(x, f)
            guess = np.where(both, tracks(guess), guess)
        guess = np.clip(guess, self._start - self._reach, self._start + self._reach)
        guess = self._side * np.minimum(self._side * guess, self._side * self._goal)
        self._speed = np.where(going, np.where(slowed, guess, self._goal), self._speed)

    def _error(self) -> Array:
        """Speeds minus set points (N, 2) [rad/s]."""
        return np.where(self._speed == self._goal, self._wanted.error, self._speed - self._drive.set_point)


class _Roots:
    """Roots of increasing functions of one variable each: bracketed secant method, with bisection when it is slow.

    Each function may depend slightly on the other variables, so a bracket that is no longer one is dropped.
    """

    def __init__(self, slope: Array) -> None:
        """`slope` (N, 2): a first guess; no function of a row is much steeper than its largest slope."""
        self._slope = slope
        self._steepest = slope.max(axis=1, keepdims=True)
        self._low: Array = np.full(slope.shape, -np.inf)
        self._high: Array = np.full(slope.shape, np.inf)
        self._width: Array = np.full(slope.shape, np.inf)
        self._x: Array = np.full(slope.shape, np.nan)
        self._f: Array = np.zeros(slope.shape)

    def restart(self, rows: np.ndarray, slope: Array) -> None:
        """Restart the search in some rows (N, 1), with slopes (N, 2)."""
        self._slope = np.where(rows, slope, self._slope)
        self._low, self._high = np.where(rows, -np.inf, self._low), np.where(rows, np.inf, self._high)
        self._width = np.where(rows, np.inf, self._width)
        self._x = np.where(rows, np.nan, self._x)

    def next(self, x: Array, f: Array) -> Array:
        """The next trial (N, 2), given that the functions are f (N, 2) at x (N, 2)."""
        low, high = np.where(f < 0, x, self._low), np.where(f > 0, x, self._high)
        outside = np.abs(f) > 4 * self._steepest * (high - low)
        low, high = np.where(outside & (f > 0), -np.inf, low), np.where(outside & (f <= 0), np.inf, high)
        run, rise = x - self._x, f - self._f
        rising, falling = run * rise > 0, (run * rise <= 0) & (f * self._f > 0)  # neither, without a previous point
        self._slope = np.where(rising, rise / np.where(rising, run, 1.0), self._slope)
        self._slope = np.where(falling, self._slope / 3, self._slope)  # the tracks slide: take a larger step
        guess = x - f / self._slope
        bracketed = np.isfinite(low) & np.isfinite(high)
        slow = np.isfinite(self._width) & (high - low > self._width / 2)
        halve = bracketed & (slow | (guess <= low) | (guess >= high))
        middle = np.where(bracketed, low, 0.0) / 2 + np.where(bracketed, high, 0.0) / 2
        self._low, self._high, self._width, self._x, self._f = low, high, high - low, x, f
        return np.where(halve, middle, guess)
