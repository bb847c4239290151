"""Odometry by a slip law: computes poses with covariance from encoder readings.

Between two readings, the robot drives an arc with the twist that the law predicts from the sprocket
speeds. To first order, the errors dz_T and dphi_T of place and heading are sums over the arcs: arc
k has an error e_k of its displacement, in the world frame, and an error d_k of its turn, which also
turns the path after arc k,

    dz_T = sum_k (e_k - d_k J m_k) + (sum_k d_k) J z_T        dphi_T = sum_k d_k        J = quarter
    turn

where m_k is the middle of arc k. So sums of moments of e_k - d_k J m_k and of d_k, computed once
along the path, determine the covariance at every pose, and step-by-step odometry equals the
odometry of a whole log to the last bit.

Turns come from gyro readings where these exist, since errors of laws persist, unlike noise. While
the sprockets stand still and the gyro reads almost nothing, the robot doesn't turn, and the mean
reading is the gyro's bias.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from trackslip.errors import require, require_finite
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.base import SlipLaw
from trackslip.odometry.uncertainty import Gyro, LawErrors, SlipNoise
from trackslip.se2 import arc_quotients

_STILL = 1e-3  # largest sprocket speed of a robot at rest [rad/s]
_MAX_DRIFT = 0.05  # largest reading of a gyro at rest, minus its bias [rad/s]
_TRUSTED = 5.0  # weight of the initial bias, as a time at rest with readings [s]


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

    place: np.ndarray  # (...) complex, x + i y from the start [m]
    heading: Array  # (...) [rad]
    moments: Array  # (..., 3, 3) second moments of the sums of e - d J m and of d
    swing: Array  # (..., p) derivatives of the heading by the parameters
    drift: np.ndarray  # (..., p) complex, derivatives of the place by the parameters
    rest: Array  # (..., 2) time at rest [s], and the gyro's turn at rest [rad]


class SlipOdometry:
    """Dead reckoning for one or many robots by a slip law, with the covariance of the pose.

    The pose is that of the turning centre, which has no lateral speed except from `drift`, and may
    lie ahead of or behind the middle of the tracks. The covariance contains the covariance at the
    start, varying slip (`noise`) and errors of the law's parameters (`errors`), which are constant
    along the whole path. It contains neither errors of the geometry, which the parameters absorb,
    nor differences in slip between the actual ground and the law's ground.
    """

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
        self.law, self.geometry, self.drift = law, geometry, drift
        self.noise = noise or SlipNoise()
        self.errors = errors or LawErrors((), np.zeros((0, 0)))
        self.gyro, self._errors = gyro, self.errors.covariance
        if gyro is not None:
            of_gyro = np.diag(np.square([gyro.bias_error, gyro.scale_error]))
            self._errors = scipy.linalg.block_diag(self._errors, of_gyro)
        self.reset(start, start_covariance)

    def reset(self, pose: ArrayLike = (0.0, 0.0, 0.0), covariance: ArrayLike | None = None) -> None:
        """Restart from a pose or poses (..., 3) [m, m, rad] with covariance (..., 3, 3), by default
        zero.
        """
        self._start = _finite("pose", pose, (3,))
        known = (
            np.zeros((3, 3)) if covariance is None else _finite("covariance", covariance, (3, 3))
        )
        shape, p, bias = (
            self._start.shape[:-1],
            len(self._errors),
            self.gyro.bias if self.gyro else 0.0,
        )
        self._state = _State(
            np.zeros(shape, complex),
            self._start[..., 2].copy(),
            np.broadcast_to(known, (*shape, 3, 3)).copy(),
            np.zeros((*shape, p)),
            np.zeros((*shape, p), complex),
            np.broadcast_to(_TRUSTED * np.array([1.0, bias]), (*shape, 2)),
        )

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
        after = self._driven(omega[None], np.array([dt]), _readings(gyro, omega)[None])
        self._state = _State(*(value[-1] for value in vars(after).values()))

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
        time, omega = np.asarray(time, float), _finite("omega", omega, (2,))
        step = np.diff(time)
        fits = omega.ndim > 1 and time.shape == omega.shape[:1] and len(time) > 0
        require(fits, "time", time.shape, f"one time per row of omega, ({len(omega)},)")
        ascends = np.isfinite(time).all() and (step > 0).all()
        require(ascends, "time", float(time[0]), "finite, and ascending from row to row")
        states = self._driven(omega[1:], step, _readings(gyro, omega)[1:])
        return OdometryPath(time, self._poses(states), self._covariances(states))

    def _driven(self, omega: Array, step: Array, gyro: Array) -> _State:
        """The current state and the states (T + 1, ...) after driving at each `omega` (T, ..., 2)
        for `step` (T,).
        """
        now, geometry = self._state, self.geometry
        dt = step.reshape(-1, *[1] * (omega.ndim - 2))
        twist = self.law.twist(omega, geometry)
        v, w = np.broadcast_arrays(twist[..., 0], twist[..., 1])
        slopes = self.errors.slopes(self.law, omega, geometry)
        way = geometry.sprocket_radius * np.abs(omega).mean(axis=-1) * dt
        if len(self._errors) > slopes.shape[-1]:
            slopes = np.concatenate([slopes, np.zeros((*slopes.shape[:-1], 2))], axis=-1)
        w, variance, rest = self._with_gyro(gyro, omega, w, dt, self.noise.turn**2 * way, slopes)
        speed, turn = v - 1j * self.drift * v * w, w * dt
        along, across, d_along, d_across = arc_quotients(turn)
        heading = _summed(now.heading, turn)
        before = heading[:-1]
        moved = speed * dt * (along + 1j * across) * np.exp(1j * before)
        place = _summed(now.place, moved)
        dv, dw = slopes[..., 0, :], slopes[..., 1, :]
        swing = _summed(now.swing, dw * dt[..., None])
        by_speed = dv - 1j * self.drift * (dv * w[..., None] + v[..., None] * dw)
        aside: np.ndarray = by_speed * (dt * (along + 1j * across) * np.exp(1j * before))[..., None]
        aside = (
            aside
            + dw * (speed * dt**2 * (d_along + 1j * d_across) * np.exp(1j * before))[..., None]
        )
        aside = aside + 1j * swing[:-1] * moved[..., None]
        moments = self._moments(place[:-1] + moved / 2, moved, before + turn / 2, way, variance)
        return _State(
            place, heading, _summed(now.moments, moments), swing, _summed(now.drift, aside), rest
        )

    def _with_gyro(
        self, gyro: Array, omega: Array, w: Array, dt: Array, variance: Array, slopes: Array
    ) -> tuple[Array, Array, Array]:
        """Yaw rates and turn variances (T, ...), from gyro readings or otherwise from the law; and
        `_State.rest`.

        Changes `slopes` in place.
        """
        known, errors = np.isfinite(gyro), self.gyro or Gyro()
        still = (
            known
            & (np.abs(omega) < _STILL).all(axis=-1)
            & (np.abs(gyro - errors.bias) < _MAX_DRIFT)
        )
        gyro = np.where(known, gyro, 0.0)
        rest = _summed(
            self._state.rest,
            np.where(still, dt, 0.0)[..., None] * np.stack([np.ones_like(gyro), gyro], -1),
        )
        unbiased = gyro - rest[:-1, ..., 1] / rest[:-1, ..., 0]
        taken, size = known & ~still, 1 + errors.scale
        slopes[taken, 1] = 0.0
        if self.gyro is not None:
            slopes[taken, 1, -2], slopes[taken, 1, -1] = -1 / size, -unbiased[taken] / size**2
        turning = np.where(taken, unbiased / size, w)
        return turning, np.where(taken, (errors.noise / size) ** 2 * dt, variance), rest

    def _moments(
        self, middle: np.ndarray, moved: np.ndarray, heading: Array, way: Array, variance: Array
    ) -> Array:
        """Error moments (T, ..., 3, 3) of arcs whose turns have a `variance` (T, ...).

        A heading error that grows along an arc acts like an error at the arc's middle, plus a
        scatter across the chord.
        """
        noise = self.noise
        forward = np.exp(1j * heading)
        lever = -1j * middle
        place = noise.forward**2 * _outer(forward) + noise.sideways**2 * _outer(1j * forward)
        swung = _outer(lever) + _outer(1j * moved) / 12
        moments = np.empty((*way.shape, 3, 3))
        moments[..., :2, :2] = way[..., None, None] * place + variance[..., None, None] * swung
        moments[..., 0, 2] = moments[..., 2, 0] = variance * lever.real
        moments[..., 1, 2] = moments[..., 2, 1] = variance * lever.imag
        moments[..., 2, 2] = variance
        return moments

    def _poses(self, state: _State) -> Array:
        place = state.place
        x, y = np.broadcast_arrays(
            self._start[..., 0] + place.real, self._start[..., 1] + place.imag
        )
        return np.stack([x, y, np.broadcast_to(state.heading, x.shape)], axis=-1)

    def _covariances(self, state: _State) -> Array:
        carried = np.zeros((*state.place.shape, 3, 3))
        carried[..., range(3), range(3)] = 1.0
        carried[..., 0, 2], carried[..., 1, 2] = -state.place.imag, state.place.real
        by_law = np.stack([state.drift.real, state.drift.imag, state.swing], axis=-2)
        found = carried @ state.moments @ carried.swapaxes(-1, -2)
        found = found + by_law @ self._errors @ by_law.swapaxes(-1, -2)
        return (found + found.swapaxes(-1, -2)) / 2


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
    array = np.full(omega.shape[:-1], np.nan) if gyro is None else np.asarray(gyro, float)
    require(
        array.shape == omega.shape[:-1],
        "gyro",
        array.shape,
        f"of shape {omega.shape[:-1]}, as omega",
    )
    require(
        not np.isinf(array).any(),
        "gyro",
        float(array[np.isinf(array)].sum()),
        "finite, or NaN for no reading",
    )
    return array


def _finite(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Convert to an array; raises InvalidValueError unless it is finite and its last axes have this
    shape.
    """
    array = np.asarray(values, float)
    fits = array.shape[-len(shape) :] == shape
    require(fits, name, array.shape, f"of shape (..., {', '.join(map(str, shape))})")
    require(np.isfinite(array).all(), name, float(array[~np.isfinite(array)].sum()), "finite")
    return array
