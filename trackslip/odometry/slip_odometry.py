"""Odometry by a slip law: computes poses with covariance from encoder readings.

Between two readings, the robot drives an arc with the twist that the law predicts from the sprocket
speeds. Points in the plane are complex numbers x + i y, so that a factor i is a quarter turn to the
left.

To first order, the errors dz_T of the place and dphi_T of the heading are sums over the arcs. Arc k
has an error e_k of its displacement, in the world frame, and an error d_k of its turn, which also
turns the path after arc k about the arc's middle m_k:

    dz_T = sum_k (e_k + d_k i (z_T - m_k)) = sum_k (e_k - d_k i m_k) + i z_T sum_k d_k
    dphi_T = sum_k d_k

So second moments of e_k - d_k i m_k and of d_k, summed once along the path, determine the
covariance at every pose, and step-by-step odometry equals the odometry of a whole log to the last
bit.

Turns come from gyro readings where these exist, since errors of laws persist, unlike noise. While
the sprockets stand still and the gyro reads almost nothing, the robot is at rest: the mean reading
is the gyro's bias, and turns come from the law, by which it hardly turns.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy
from numpy.typing import ArrayLike

from trackslip.arguments import checks_arguments
from trackslip.errors import InvalidValueError, require, require_finite
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.base import SlipLaw
from trackslip.odometry.uncertainty import Gyro, LawErrors, SlipNoise
from trackslip.restorable import Restorable
from trackslip.se2 import arc_quotients

# largest sprocket speed of a robot at rest [rad/s]
_MAX_SPEED_AT_REST: Final = 1e-3
# largest reading of a gyro at rest, minus its bias [rad/s]
_MAX_READING_AT_REST: Final = 0.05
# weight of the initial bias, as a time at rest with readings: a minute at rest overrules it, see
# test_at_rest_it_learns_the_bias [s]
_TIME_FOR_BIAS: Final = 5.0


@dataclass(frozen=True)
class OdometryPath:
    """Poses by odometry, with covariance."""

    time: Array  # (T,) [s]
    pose: Array  # (T, ..., 3) [m, m, rad]; headings are not wrapped
    covariance: Array  # (T, ..., 3, 3) covariance of the poses


@dataclass(frozen=True)
class _State:
    """Sums along the path up to a time, or up to each of T times, with an additional first axis
    (T,).
    """

    place: np.ndarray  # (...) complex, from the start [m]
    heading: Array  # (...) [rad]
    moments: Array  # (..., 3, 3) second moments of the sums of e - d i m and of d
    place_slopes: np.ndarray  # (..., p) complex, derivatives of the place by the parameters
    heading_slopes: Array  # (..., p) derivatives of the heading by the parameters
    rest_time: Array  # (...) time at rest with readings of the gyro [s]
    rest_turn: Array  # (...) integral of the gyro's readings over that time [rad]

    @property
    def last(self) -> _State:
        """The state at the last of T times."""
        return _State(
            place=self.place[-1],
            heading=self.heading[-1],
            moments=self.moments[-1],
            place_slopes=self.place_slopes[-1],
            heading_slopes=self.heading_slopes[-1],
            rest_time=self.rest_time[-1],
            rest_turn=self.rest_turn[-1],
        )


@dataclass(frozen=True)
class _LawTurning:
    """Yaw rates in T motions according to the law, with their errors."""

    rate: Array  # (T, ...) [rad/s]
    slopes: Array  # (T, ..., p) derivatives of the rates by the parameters
    variance: Array  # (T, ...) variances of the turns due to noise [rad^2]


@dataclass(frozen=True)
class _Turning(_LawTurning):
    """Yaw rates in T motions, from readings of the gyro or else from the law, with their errors."""

    rest_time: Array  # (T + 1, ...) see _State
    rest_turn: Array  # (T + 1, ...) see _State


@checks_arguments
class SlipOdometry(Restorable):
    """Dead reckoning for one or many robots by a slip law, with the covariance of the pose.

    The pose is that of the turning centre, which has no lateral speed except from `drift`, and may
    lie ahead of or behind the middle of the tracks. The covariance contains the covariance at the
    start, varying slip (`noise`) and errors of the law's parameters (`errors`), which are constant
    along the whole path. It contains neither errors of the geometry, which the parameters absorb,
    nor differences in slip between the actual ground and the law's ground.
    """

    STATE = ("_start",)

    def __init__(
        self,
        law: SlipLaw,
        geometry: RobotGeometry,
        noise: SlipNoise | None = None,
        errors: LawErrors | None = None,
        drift: float = 0.0,
        start: ArrayLike = (0.0, 0.0, 0.0),
        start_covariance: ArrayLike | None = None,
        gyro: Gyro | None = None,
    ) -> None:
        """Start odometry at a pose.

        Args:
            law: slip law of the robot on its ground.
            geometry: the robot's geometry, for which the law was identified.
            noise: varying slip; none by default.
            errors: errors of the law's parameters; none by default.
            drift: drift c, which causes an outward lateral speed of -c v w in turns [s].
            start: start pose or poses (..., 3) [m, m, rad].
            start_covariance: covariance (..., 3, 3) of the start pose; zero by default.
            gyro: errors of the gyroscope whose readings are passed to `update` and `path`; none by
                default.

        Raises:
            InvalidValueError: for a value that is not finite, or of the wrong shape.
        """
        require_finite("drift", drift)
        self.geometry = geometry
        self.drift = drift
        self.noise = noise or SlipNoise()
        self.gyro = gyro
        self.use(law, errors or LawErrors((), np.zeros((0, 0))))
        self.reset(start, start_covariance)

    def use(self, law: SlipLaw, errors: LawErrors) -> None:
        """Continue with another law, for example one that is learnt while driving, with errors of
        the same parameters.
        """
        self.law = law
        self.errors = errors
        # (..., p, p) covariance of the parameters: those of the law, then the gyro's bias and scale
        self._parameter_covariance = errors.covariance
        if self.gyro is not None:
            of_gyro = np.diag(np.square([self.gyro.bias_error, self.gyro.scale_error]))
            self._parameter_covariance = scipy.linalg.block_diag(errors.covariance, of_gyro)

    def reset(self, pose: ArrayLike = (0.0, 0.0, 0.0), covariance: ArrayLike | None = None) -> None:
        """Restart from a pose or poses (..., 3) [m, m, rad] with covariance (..., 3, 3), by default
        zero.
        """
        self._start = _finite("pose", pose, (3,)).copy()
        self._state = self._begun(self._start, covariance)

    def restart(self, robots: ArrayLike, pose: ArrayLike, covariance: ArrayLike) -> None:
        """Restart the `robots` (R,) of N, given by their indices, from poses (R, 3) [m, m, rad]
        with covariances (R, 3, 3).
        """
        rows = np.asarray(robots)
        start = _finite("pose", pose, (3,))
        begun = self._begun(start, covariance)
        self._start[rows] = start
        for name, values in vars(self._state).items():
            values[rows] = getattr(begun, name)

    def _begun(self, start: Array, covariance: ArrayLike | None) -> _State:
        """The state at poses (..., 3) with covariance (..., 3, 3), by default zero."""
        of_start: Array = np.zeros((3, 3))
        if covariance is not None:
            of_start = _finite("covariance", covariance, (3, 3))

        # errors at the start are an arc's at the place 0, and turn the whole path, too
        robots = start.shape[:-1]
        moments = np.broadcast_to(of_start, (*robots, 3, 3)).copy()

        # before the first reading, the bias is as if it had been read for a while
        parameters = self._parameter_covariance.shape[-1]
        bias = 0.0 if self.gyro is None else self.gyro.bias
        return _State(
            place=np.zeros(robots, complex),
            heading=start[..., 2].copy(),
            moments=moments,
            place_slopes=np.zeros((*robots, parameters), complex),
            heading_slopes=np.zeros((*robots, parameters)),
            rest_time=np.full(robots, _TIME_FOR_BIAS),
            rest_turn=np.full(robots, _TIME_FOR_BIAS * bias),
        )

    def get_state(self) -> dict[str, Any]:
        """Return a copy of the state, see Restorable."""
        sums = {name: values.copy() for name, values in vars(self._state).items()}
        return super().get_state() | sums

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a state from `get_state`, see Restorable."""
        super().set_state(state)
        self._state = _State(**{name: np.array(state[name]) for name in vars(self._state)})

    @property
    def pose(self) -> Array:
        """Pose or poses (..., 3) after the last update [m, m, rad]; headings are not wrapped."""
        return self._poses(self._state)

    @property
    def covariance(self) -> Array:
        """Covariance (..., 3, 3) of the pose after the last update."""
        return self._covariances(self._state)

    def update(self, omega: ArrayLike, dt: float, gyro: ArrayLike | None = None) -> None:
        """Update the pose for a motion with mean sprocket speeds (..., 2) [rad/s] that lasts `dt`
        [s], at least 0.

        `gyro` (...) is the mean yaw rate from a gyroscope during `dt` [rad/s], NaN without a
        reading. Raises InvalidValueError for a negative time and for values that are not finite.
        """
        require(0 <= dt < np.inf, "dt", dt, "a finite number of seconds >= 0")
        omega = _finite("omega", omega, (2,))
        reading = _readings(gyro, omega)
        self._state = self._driven(omega[None], np.array([dt]), reading[None]).last

    def path(
        self, time: ArrayLike, omega: ArrayLike, gyro: ArrayLike | None = None
    ) -> OdometryPath:
        """Compute poses at all rows of a log, starting at the current pose, without changing the
        current pose.

        Args:
            time: times (T,) of the rows, ascending [s].
            omega: sprocket speeds (T, ..., 2), means since the previous row [rad/s]; the first row
                is not used.
            gyro: yaw rates (T, ...) from a gyroscope, means since the previous row [rad/s]; NaN
                without a reading.

        Raises:
            InvalidValueError: for times that do not ascend, or values that are not finite or have
                the wrong shape.
        """
        time = np.asarray(time, float)
        omega = _finite("omega", omega, (2,))
        step = np.diff(time)
        fits = omega.ndim > 1 and time.shape == omega.shape[:1] and len(time) > 0
        require(fits, "time", time.shape, f"one time per row of omega, ({len(omega)},)")
        ascends = np.isfinite(time).all() and (step > 0).all()
        require(ascends, "time", float(time[0]), "finite, and ascending from row to row")
        readings = _readings(gyro, omega)
        states = self._driven(omega[1:], step, readings[1:])
        return OdometryPath(time, self._poses(states), self._covariances(states))

    def _driven(self, omega: Array, step: Array, gyro: Array) -> _State:
        """The current state and the states (T + 1, ...) after driving at each `omega` (T, ..., 2)
        for `step` (T,).

        `gyro` (T, ...) are mean yaw rates from a gyroscope [rad/s], NaN without a reading.

        An arc starts at the heading phi and lasts for the time h, with the speed v and the yaw rate
        w. In its own frame, the robot has the velocity u = v - i c v w, forwards and to the left,
        where c is `drift`. So it turns by t = w h, and moves by

            m = u h q(t) exp(i phi)        q(t) = sin(t) / t + i (1 - cos(t)) / t

        With the derivatives v' and w' by a parameter, and phi' of the heading at the start, those
        of the turn and the displacement are

            t' = w' h
            u' = v' - i c (v' w + v w')
            m' = (u' h q(t) + w' u h^2 dq/dt) exp(i phi) + i phi' m
        """
        start = self._state
        h = np.expand_dims(step, tuple(range(1, omega.ndim - 1)))  # (T, ...), for all robots

        # the twists by the law, with the gyro's yaw rates where it has readings
        twist = self.law.twist(omega, self.geometry)
        speed = twist[..., 0]
        speed_slopes, law_rate_slopes = self._law_slopes(omega)
        distance = self.geometry.sprocket_radius * np.abs(omega).mean(axis=-1) * h
        by_law = _LawTurning(twist[..., 1], law_rate_slopes, self.noise.turn**2 * distance)
        turning = self._turning(omega, h, gyro, by_law)
        rate = turning.rate

        # headings, displacements and places
        turn = rate * h
        heading = _summed(start.heading, turn)
        heading_before = heading[:-1]
        along, across, along_slope, across_slope = arc_quotients(turn)
        quotient = along + 1j * across
        quotient_slope = along_slope + 1j * across_slope
        ahead = np.exp(1j * heading_before)
        velocity = speed - 1j * self.drift * speed * rate
        displacement = velocity * h * quotient * ahead
        place = _summed(start.place, displacement)

        # their derivatives by the parameters, on the last axis
        rate_slopes = turning.slopes
        heading_slopes = _summed(start.heading_slopes, rate_slopes * h[..., None])
        velocity_slopes = speed_slopes - 1j * self.drift * (
            speed_slopes * rate[..., None] + speed[..., None] * rate_slopes
        )
        by_velocity = h * quotient * ahead
        by_rate = velocity * h**2 * quotient_slope * ahead
        displacement_slopes = (
            velocity_slopes * by_velocity[..., None]
            + rate_slopes * by_rate[..., None]
            + 1j * heading_slopes[:-1] * displacement[..., None]
        )

        # moments of the errors that vary from arc to arc
        middle = place[:-1] + displacement / 2
        middle_heading = heading_before + turn / 2
        moments = self._moments(middle, middle_heading, displacement, distance, turning.variance)
        return _State(
            place=place,
            heading=heading,
            moments=_summed(start.moments, moments),
            place_slopes=_summed(start.place_slopes, displacement_slopes),
            heading_slopes=heading_slopes,
            rest_time=turning.rest_time,
            rest_turn=turning.rest_turn,
        )

    def _law_slopes(self, omega: Array) -> tuple[Array, Array]:
        """Derivatives (T, ..., p) of the law's speeds and yaw rates at `omega` (T, ..., 2) by the
        parameters.
        """
        slopes = self.errors.slopes(self.law, omega, self.geometry)
        # the gyro's, without effect
        others = self._parameter_covariance.shape[-1] - slopes.shape[-1]
        slopes = np.concatenate([slopes, np.zeros((*slopes.shape[:-1], others))], axis=-1)
        return slopes[..., 0, :], slopes[..., 1, :]

    def _turning(self, omega: Array, h: Array, gyro: Array, by_law: _LawTurning) -> _Turning:
        """Yaw rates during T motions at `omega` (T, ..., 2) that last for `h` (T, ...).

        Where `gyro` (T, ...) has a reading g, the yaw rate is (g - b) / (1 + k) with the gyro's
        bias b and scale error k; its derivatives are -1 / (1 + k) by b and -(g - b) / (1 + k)^2 by
        k. Elsewhere, and at rest, it is that `by_law`.
        """
        errors = self.gyro or Gyro()
        has_reading = np.isfinite(gyro)
        reading = np.where(has_reading, gyro, 0.0)

        # the bias is the mean reading at rest before each motion
        stands = (np.abs(omega) < _MAX_SPEED_AT_REST).all(axis=-1)
        reads_nothing = np.abs(reading - errors.bias) < _MAX_READING_AT_REST
        is_at_rest = has_reading & stands & reads_nothing
        at_rest = np.where(is_at_rest, h, 0.0)
        rest_time = _summed(self._state.rest_time, at_rest)
        rest_turn = _summed(self._state.rest_turn, at_rest * reading)
        bias = rest_turn[:-1] / rest_time[:-1]

        is_measured = has_reading & ~is_at_rest
        scale = 1 + errors.scale
        measured_rate = (reading - bias) / scale
        slopes = np.where(is_measured[..., None], 0.0, by_law.slopes)
        if self.gyro is not None:  # its bias and scale are the last parameters
            slopes[..., -2] = np.where(is_measured, -1 / scale, 0.0)
            slopes[..., -1] = np.where(is_measured, -(reading - bias) / scale**2, 0.0)
        gyro_variance = (errors.noise / scale) ** 2 * h
        return _Turning(
            rate=np.where(is_measured, measured_rate, by_law.rate),
            slopes=slopes,
            variance=np.where(is_measured, gyro_variance, by_law.variance),
            rest_time=rest_time,
            rest_turn=rest_turn,
        )

    def _moments(
        self,
        middle: np.ndarray,
        heading: Array,
        displacement: np.ndarray,
        distance: Array,
        turn_variance: Array,
    ) -> Array:
        """Second moments (T, ..., 3, 3) of the errors e - d i m and d of arcs.

        The arcs have the complex `middle` m (T, ...) and `displacement` (T, ...) [m], and in their
        middle the `heading` (T, ...). The belts drive the `distance` (T, ...) [m]. The errors e are
        white slip per distance, forwards and sideways. The errors d have `turn_variance` (T, ...).

        The heading error of an arc is a random walk from 0 to d. Its mean over the arc is d / 2,
        which acts like an error d at the arc's middle, plus a deviation that doesn't depend on d
        and has the variance var(d) / 12, which acts across the displacement.
        """
        forward = np.exp(1j * heading)
        leftward = 1j * forward
        by_slip = self.noise.forward**2 * _outer(forward) + self.noise.sideways**2 * _outer(
            leftward
        )

        lever = -1j * middle  # displacement by a unit of d
        by_turn = _outer(lever) + _outer(1j * displacement) / 12

        moments = np.empty((*distance.shape, 3, 3))
        moments[..., :2, :2] = (
            distance[..., None, None] * by_slip + turn_variance[..., None, None] * by_turn
        )
        # of x, y and the heading
        moments[..., 0, 2] = turn_variance * lever.real
        moments[..., 1, 2] = turn_variance * lever.imag
        moments[..., 2, 0] = moments[..., 0, 2]
        moments[..., 2, 1] = moments[..., 1, 2]
        moments[..., 2, 2] = turn_variance
        return moments

    def _poses(self, state: _State) -> Array:
        """Poses (..., 3) in a state."""
        x = self._start[..., 0] + state.place.real
        y = self._start[..., 1] + state.place.imag
        return np.stack([x, y, state.heading], axis=-1)

    def _covariances(self, state: _State) -> Array:
        """Covariances (..., 3, 3) of the poses in a state.

        The errors of the place z and of the heading are the sums of e - d i m and of d, times

            1  0  -y
            0  1   x
            0  0   1

        as the sum of d also turns the whole path, by i z. To these are added the errors of the
        parameters, by the derivatives of the pose.
        """
        carry = np.zeros((*state.place.shape, 3, 3))
        carry[...] = np.eye(3)
        carry[..., 0, 2] = -state.place.imag
        carry[..., 1, 2] = state.place.real
        of_arcs = carry @ state.moments @ carry.swapaxes(-1, -2)

        slopes = np.stack(
            [state.place_slopes.real, state.place_slopes.imag, state.heading_slopes], axis=-2
        )
        of_parameters = slopes @ self._parameter_covariance @ slopes.swapaxes(-1, -2)
        covariance = of_arcs + of_parameters
        return (covariance + covariance.swapaxes(-1, -2)) / 2  # symmetric despite rounding


def _outer(vector: np.ndarray) -> Array:
    """Outer products (..., 2, 2) of complex vectors (...) with themselves."""
    pair = np.stack([vector.real, vector.imag], axis=-1)
    return np.asarray(pair[..., :, None] * pair[..., None, :])


def _summed(first: np.ndarray, increments: np.ndarray) -> np.ndarray:
    """Cumulative sums (T + 1, ...) that begin with `first`; increments are added one by one, as in
    single steps.
    """
    begin = np.broadcast_to(first, increments.shape[1:])[None]
    return np.cumsum(np.concatenate([begin, increments]), axis=0)


def _readings(gyro: ArrayLike | None, omega: Array) -> Array:
    """Validate gyro readings (...) for sprocket speeds (..., 2); NaN without a reading."""
    expected = omega.shape[:-1]
    if gyro is None:
        return np.full(expected, np.nan)
    array = np.asarray(gyro, float)
    require(array.shape == expected, "gyro", array.shape, f"of shape {expected}, as omega")
    infinite = array[np.isinf(array)]
    if infinite.size:
        raise InvalidValueError("gyro", float(infinite[0]), "finite, or NaN for no reading")
    return array


def _finite(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Convert to an array; raises InvalidValueError unless it is finite and its last axes have this
    shape.
    """
    array = np.asarray(values, float)
    fits = array.shape[-len(shape) :] == shape
    require(fits, name, array.shape, f"of shape (..., {', '.join(map(str, shape))})")
    wrong = array[~np.isfinite(array)]
    if wrong.size:
        raise InvalidValueError(name, float(wrong[0]), "finite")
    return array
