"""The speeds that motors at their limits can hold."""

from __future__ import annotations

import numpy as np

from sim.drive.drive import DriveState, Forecast
from trackslip.kinematics import Array

_ATTEMPTS = 40
_TOLERANCE = 0.001  # of the torque at the limit, relative to the largest torque
_ROUGHNESS = 0.0002  # of the ground's answer, for its forces are found by iteration, relative to the weight
_FIERCEST = 3.0  # acceleration of a track that no ground or slope exceeds, in units of gravity
# first guess of what the ground answers to a change of the belts' speeds: torque over mass, radius squared, speed [1/s]
_ALIKE = 25.0  # both tracks alike: the robot is pushed along
_OPPOSED = 12_000.0  # one against the other: friction holds the heading, until it slides


class SpeedSearch:
    """Finds, for one servo period, speeds at which the torques are within the motors' limits.

    A robot whose motors are strong enough does what the servo wants. Another one's belts run at their sprockets' final
    speeds all through the period, so that however stiff the grip nothing rings, and a sprocket whose motor is too weak
    for what the servo wants is slower, by as much as it takes. Slower means less in the direction of the torque. What
    torque a belt's speed takes is found by trying it on the ground.

    A robot with one slow sprocket is searched along that track. With two, the searches are along their mean and half
    their difference, which hardly depend on each other, whereas the tracks do: the ground answers a difference hundreds
    of times more stiffly, until the robot begins to turn. Every robot's search depends on itself only.
    """

    def __init__(self, drive: DriveState, mass: float, gravity: float) -> None:
        """Try what the servo wants first.

        Args:
            drive: the sprockets, whose period comes true in the end.
            mass: of each robot [kg].
            gravity: [m/s^2].
        """
        self._drive = drive
        self._wanted = drive.forecast(1)
        self._start, self._goal = self._wanted.omega
        self._reach = np.abs(self._goal - self._start) + _FIERCEST * gravity * drive.period / drive.radius
        self._tolerance = _TOLERANCE * drive.torque_limit + _ROUGHNESS * mass * gravity * drive.radius
        self._speed = self._goal  # of the sprockets at the end of the period
        self._weak = np.zeros((len(self._goal), 1), bool)  # robots that can't do what the servo wants
        self._side = np.zeros(self._goal.shape)  # of the limit that is reached: 1, -1, or 0 for none
        self._slowed = np.zeros(self._goal.shape, bool)  # tracks whose speeds are being searched
        self._stiffness = drive.rotor_stiffness + mass * drive.radius**2 * [_ALIKE, _OPPOSED]
        self._roots = _Roots(self._stiffness)
        self._attempts = 0

    @property
    def belt(self) -> Array:
        """Mean sprocket speeds (1, N, 2) [rad/s] to try."""
        return np.where(self._weak, self._speed, self._wanted.mean)

    def done(self, traction: Array) -> bool:
        """Take the tractions (1, N, 2) [N] that the trial met; False if another trial is needed."""
        drive, wished = self._drive, self._speed == self._goal
        trial = Forecast(np.stack([self._start, self._speed]), self.belt, self._error())
        torque = drive.torque_for(trial, traction)[0]
        least, most = drive.torque_range(self._speed)
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
        # finish with the tracks at hand before taking up others, for which a passing trial may be too fast
        busy = (far & slowed).any(axis=1, keepdims=True)
        self._next(excess, going, np.where(busy, slowed, side != 0))
        return False

    def _next(self, excess: Array, going: np.ndarray, slowed: np.ndarray) -> None:
        """Another trial, slowing the tracks `slowed` (N, 2) of the robots (N, 1) that are still going."""
        both = slowed.all(axis=1, keepdims=True)
        changed = (slowed != self._slowed).any(axis=1, keepdims=True)
        self._slowed = slowed
        self._roots.restart(changed, np.where(both, self._stiffness, self._stiffness.mean(axis=1, keepdims=True)))
        if self._attempts == 1:  # set out from where the belts turn the robot no faster than they did
            self._weak = going
            guess = np.where(both, self._start, self._start + (self._goal - self._start)[:, ::-1])
        else:
            x, f = (np.where(both, _modes(tracks), tracks) for tracks in (self._speed, excess))
            guess = self._roots.next(x, f)
            guess = np.where(both, _tracks(guess), guess)
        guess = np.clip(guess, self._start - self._reach, self._start + self._reach)
        guess = self._side * np.minimum(self._side * guess, self._side * self._goal)
        self._speed = np.where(going, np.where(slowed, guess, self._goal), self._speed)

    def _error(self) -> Array:
        """Of the speeds (N, 2), against the set points [rad/s]."""
        return np.where(self._speed == self._goal, self._wanted.error, self._speed - self._drive.set_point)


class _Roots:
    """Where rising functions, of a variable each, are zero: the secant method within brackets, halved when it is slow.

    Each function may depend a little on the other variables: a bracket that can't be one any more is dropped.
    """

    def __init__(self, slope: Array) -> None:
        """`slope` (N, 2): a first guess; the largest of a row is what no function of it exceeds by far."""
        self._slope = slope
        self._steepest = slope.max(axis=1, keepdims=True)
        self._low: Array = np.full(slope.shape, -np.inf)
        self._high: Array = np.full(slope.shape, np.inf)
        self._width: Array = np.full(slope.shape, np.inf)
        self._x: Array = np.full(slope.shape, np.nan)
        self._f: Array = np.zeros(slope.shape)

    def restart(self, rows: np.ndarray, slope: Array) -> None:
        """Forget what is known of some rows (N, 1)."""
        self._slope = np.where(rows, slope, self._slope)
        self._low, self._high = np.where(rows, -np.inf, self._low), np.where(rows, np.inf, self._high)
        self._width = np.where(rows, np.inf, self._width)
        self._x = np.where(rows, np.nan, self._x)

    def next(self, x: Array, f: Array) -> Array:
        """Where to look next, knowing that the functions are f (N, 2) at x (N, 2)."""
        low, high = np.where(f < 0, x, self._low), np.where(f > 0, x, self._high)
        outside = np.abs(f) > 4 * self._steepest * (high - low)
        low, high = np.where(outside & (f > 0), -np.inf, low), np.where(outside & (f <= 0), np.inf, high)
        run, rise = x - self._x, f - self._f
        rising, falling = run * rise > 0, (run * rise <= 0) & (f * self._f > 0)  # neither without a point before
        self._slope = np.where(rising, rise / np.where(rising, run, 1.0), self._slope)
        self._slope = np.where(falling, self._slope / 3, self._slope)  # the ground slides: look further away
        guess = x - f / self._slope
        bracketed = np.isfinite(low) & np.isfinite(high)
        slow = np.isfinite(self._width) & (high - low > self._width / 2)
        halve = bracketed & (slow | (guess <= low) | (guess >= high))
        middle = np.where(bracketed, low, 0.0) / 2 + np.where(bracketed, high, 0.0) / 2
        self._low, self._high, self._width, self._x, self._f = low, high, high - low, x, f
        return np.where(halve, middle, guess)


def _modes(tracks: Array) -> Array:
    """Mean and half difference (N, 2) of the (left, right) tracks (N, 2)."""
    left, right = tracks.T
    return np.stack([left + right, right - left], axis=-1) / 2


def _tracks(modes: Array) -> Array:
    """The inverse of `_modes`."""
    mean, difference = modes.T
    return np.stack([mean - difference, mean + difference], axis=-1)
