"""Online slip estimation: an extended Kalman filter for the pose and the constants D and epsilon of
constant ICRs.

Between two scans the encoders measure the distances that the belts move. With constant ICRs the
robot drives an arc:

    v = (1 + epsilon) (s_r + s_l) / 2        w = (1 + epsilon) g (s_r - s_l) / (2 b)        g = b /
    (b + D)

with belt speeds s = r omega. The turning centre is not always beside the robot's centre: with the
centre of mass ahead, or when a fast robot skids on slippery ground, it is ahead by c, and the
robot's centre drifts sideways at -c w. A scan measures the pose. The state is (x, y, phi, g,
epsilon, c). The rates are linear in the yaw gain g, whereas a filter linearised in D diverges if
the initial D is very wrong. The process noise of the constants grows with the distance and turn
driven, not with time, so a constant that a motion does not excite (D on a straight path, or all at
rest) keeps its value and its uncertainty. While a robot turns so slowly that the turn may be noise,
g and c are considered but not updated: a controller responds to scan noise with small turns, from
which wrong g and c would be learnt.

Two gates monitor the innovations. A pose whose innovation is too large for scan noise is rejected;
several rejections in a row indicate that the filter is wrong. Small innovations with a persistent
bias indicate that the ground has changed. In both cases the filter restarts from the scanned pose,
with the initial uncertainty of the constants.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip import se2
from trackslip.kinematics import Array, RobotGeometry, wrap_angle
from trackslip.laws.icr import ConstantIcr
from trackslip.localization.scan import PoseEstimate
from trackslip.restorable import Restorable

_LIMITS = np.array([(0.05, -0.5, -1.0), (10.0, 0.5, 1.0)])  # limits on g [-], epsilon [-] and c [m]
_KNOWN = 0.15  # factor on the initial spreads if the filter starts from a known law [-]
_LEAST_TURN = 0.015  # mean yaw rate above which g and c are updated [rad/s]
_FLOOR = 1e-4  # standard deviation added to that of a measured pose, in quadrature [m, rad]
# normalised squared innovation above which a pose is rejected (chi-square, 3 degrees of freedom)
_OUTLIER = 30.0
_PATIENCE = 5  # number of rejections in a row after which the filter restarts
# normalised squared mean innovation that indicates changed ground (chi-square, 3 degrees of
# freedom)
_CHANGE = 60.0
_MEMORY = 10.0  # time constant of the mean innovation and yaw rate [scans]


@dataclass(frozen=True)
class FilterTuning:
    """Initial standard deviations and process noise that the filter assumes."""

    gain_spread: float = 0.3  # standard deviation of g without prior knowledge [-]
    radius_error_spread: float = 0.02  # standard deviation of epsilon without prior knowledge [-]
    centre_spread: float = 0.03  # standard deviation of c without prior knowledge [m]
    gain_walk: float = 0.003  # process noise of g [1/sqrt(rad) turned]
    radius_error_walk: float = 0.0005  # process noise of epsilon [1/sqrt(m) driven]
    centre_walk: float = 0.003  # process noise of c [m per sqrt(rad) turned]
    position_walk: float = 0.002  # process noise of the position [m per sqrt(m) driven]
    heading_walk: float = 0.003
    """Process noise of the heading [rad per sqrt(rad) turned, and per sqrt(m) driven]."""


class IcrFilter(Restorable):
    """Extended Kalman filter for the poses, D and epsilon of N independent robots."""

    STATE = (
        "state",
        "covariance",
        "restarts",
        "_drift",
        "_drift_variance",
        "_rejected",
        "_turning",
    )

    def __init__(
        self,
        start: ArrayLike,
        geometry: RobotGeometry,
        law: ConstantIcr | None = None,
        tuning: FilterTuning | None = None,
    ) -> None:
        """Start at known poses (N, 3) with D and epsilon from `law`, or with D = epsilon = 0
        without a law.
        """
        self._geometry, self._tuning = geometry, tuning or FilterTuning()
        spreads = (
            self._tuning.gain_spread,
            self._tuning.radius_error_spread,
            self._tuning.centre_spread,
        )
        self._spreads = np.array(spreads)  # initial standard deviations of g, epsilon and c
        pose = np.atleast_2d(np.asarray(start, float))
        n = len(pose)
        self.state = np.zeros((n, 6))
        """States (N, 6): x, y [m], phi [rad], g, epsilon [-], c [m]."""
        self._prior = np.tile([1.0, 0.0, 0.0], (n, 1))  # (N, 3): initial g, epsilon and c
        self._share = 1.0 if law is None else _KNOWN  # factor on the initial spreads
        if law is not None:
            self._prior[:, 0] = geometry.half_gauge / (geometry.half_gauge + law.offset)
            self._prior[:, 1] = law.radius_error
        self.covariance = np.zeros((n, 6, 6))
        """Covariances (N, 6, 6) of the state."""
        self.restarts = np.zeros(n, int)
        """Numbers of restarts (N,)."""
        self._drift = np.zeros((n, 3))  # exponentially weighted sum of whitened innovations
        self._drift_variance = np.zeros(n)
        self._rejected = np.zeros(n, int)  # number of poses rejected in a row
        self._turning = np.zeros(n)  # recent mean yaw rate [rad/s]
        self.start(np.arange(n), pose)

    def start(self, robots: np.ndarray, pose: Array) -> None:
        """Restart the robots with indices `robots` (R,) at known poses (R, 3)."""
        self.state[robots, 3:] = self._prior[robots]
        self.restarts[robots], self._turning[robots] = 0, 0.0
        self._begin(robots, pose, np.zeros((len(robots), 3, 3)), self._share)

    @property
    def law(self) -> ConstantIcr:
        """Slip law with the current estimates, whose parameters are (N,)."""
        return ConstantIcr(self.offset, self._geometry.half_gauge, self.state[:, 4].copy())  # type: ignore[arg-type]

    @property
    def offset(self) -> Array:
        """Estimates of D (N,) [m]."""
        return self._geometry.half_gauge * (1 / self.state[:, 3] - 1)

    def update(
        self, omega: Array, duration: float, estimate: PoseEstimate, known: Array | None = None
    ) -> None:
        """Process mean sprocket speeds (N, 2) [rad/s] over `duration` [s] and the poses measured
        afterwards.

        Velocities `known` (N, 3) (forwards, leftwards, yaw) are added to the velocities from the
        constant ICRs.
        """
        self._predict(omega, duration, known)
        rows = np.flatnonzero(estimate.valid)
        if rows.size:
            self._correct(rows, estimate.pose[rows], estimate.covariance[rows])

    def _predict(self, omega: Array, duration: float, known: Array | None) -> None:
        tuning = self._tuning
        velocity, by_law = icr_motion(self.state[:, 3:], omega, self._geometry)  # (N, 3), (N, 3, 3)
        velocity = velocity if known is None else velocity + known
        motion, by_law = velocity * duration, by_law * duration
        self.state[:, :3], by_pose, by_motion = se2.drive(self.state[:, :3], motion)
        jacobian = np.zeros_like(self.covariance)
        jacobian[:, :3, :3] = by_pose
        jacobian[:, :3, 3:] = np.einsum("nij,njk->nik", by_motion, by_law)
        jacobian[:, [3, 4, 5], [3, 4, 5]] = 1.0
        self.covariance = np.einsum("nij,njk,nlk->nil", jacobian, self.covariance, jacobian)
        self._turning += (velocity[:, 2] - self._turning) / _MEMORY
        way, turn = np.abs(motion[:, 0]), np.abs(motion[:, 2])
        excited = np.stack([way, way, way + turn, turn, way, turn], axis=1)
        pose_walks = (tuning.position_walk, tuning.position_walk, tuning.heading_walk)
        walks = (*pose_walks, tuning.gain_walk, tuning.radius_error_walk, tuning.centre_walk)
        self.covariance[:, np.arange(6), np.arange(6)] += excited * np.square(walks)
        for k, most in enumerate(self._spreads, 3):
            # never more uncertain than without prior knowledge
            over = self.covariance[:, k, k] > most**2
            shrink = np.where(over, most / np.sqrt(self.covariance[:, k, k]), 1.0)
            self.covariance[:, k, :] *= shrink[:, None]
            self.covariance[:, :, k] *= shrink[:, None]

    def _correct(self, rows: np.ndarray, pose: Array, noise: Array) -> None:
        innovation = pose - self.state[rows, :3]
        innovation[:, 2] = wrap_angle(innovation[:, 2])
        noise = noise + _FLOOR**2 * np.eye(3)
        spread = self.covariance[rows, :3, :3] + noise
        root = np.linalg.cholesky((spread + spread.swapaxes(1, 2)) / 2)
        white = np.linalg.solve(root, innovation[..., None])[..., 0]
        surprising = np.einsum("ni,ni->n", white, white) > _OUTLIER
        self._rejected[rows] = np.where(surprising, self._rejected[rows] + 1, 0)
        good = np.flatnonzero(~surprising)
        self._learn(rows[good], white[good], root[good])
        drift = np.einsum("ni,ni->n", self._drift[rows], self._drift[rows])
        changed = drift > _CHANGE * np.maximum(self._drift_variance[rows], 1.0)
        again = changed | (self._rejected[rows] >= _PATIENCE)
        self.restarts[rows[again]] += 1
        self._begin(rows[again], pose[again], noise[again], 1.0)

    def _learn(self, rows: np.ndarray, white: Array, root: Array) -> None:
        """Update the states with innovations `white` (R, 3), whitened by the roots (R, 3, 3) of
        their covariances.
        """
        half = np.linalg.solve(root, self.covariance[rows, :3, :]).swapaxes(1, 2)  # (R, 6, 3)
        taken = half.copy()
        slow = np.abs(self._turning[rows]) < _LEAST_TURN
        taken[np.ix_(slow, [3, 5])] = 0.0  # g and c are considered but not updated
        self.state[rows] += np.einsum("nij,nj->ni", taken, white)
        crossed = np.einsum("nik,njk->nij", taken, half)
        covariance = self.covariance[rows] - crossed - crossed.swapaxes(1, 2)
        covariance += np.einsum("nik,njk->nij", taken, taken)
        self.covariance[rows] = (covariance + covariance.swapaxes(1, 2)) / 2
        self.state[rows, 3:] = np.clip(self.state[rows, 3:], *_LIMITS)
        fade = 1 - 1 / _MEMORY
        self._drift[rows] = fade * self._drift[rows] + white
        self._drift_variance[rows] = fade**2 * self._drift_variance[rows] + 1

    def _begin(self, rows: np.ndarray, pose: Array, noise: Array, share: float) -> None:
        """Start or restart at poses (R, 3) with covariances `noise` (R, 3, 3), and initial spreads
        times `share`.
        """
        self.state[rows, :3] = pose
        self.covariance[rows] = 0.0
        self.covariance[rows[:, None, None], np.arange(3)[:, None], np.arange(3)] = noise
        self.covariance[rows, 3:, 3:] = np.diag((share * self._spreads) ** 2)
        self._drift[rows], self._drift_variance[rows], self._rejected[rows] = 0.0, 0.0, 0


def icr_motion(law: Array, omega: Array, geometry: RobotGeometry) -> tuple[Array, Array]:
    """Velocities (N, 3) and their derivatives (N, 3, 3) at sprocket speeds omega (N, 2) [rad/s].

    A velocity is (forward speed, lateral speed to the left, yaw rate). The derivatives are with
    respect to the law's (g, epsilon, c) (N, 3).
    """
    gain, scale, centre = law[:, 0], 1 + law[:, 1], law[:, 2]
    left, right = (geometry.sprocket_radius * omega).T
    speed, turning = (right + left) / 2, (right - left) / (2 * geometry.half_gauge)
    yaw_rate = scale * gain * turning
    derivative = np.zeros((len(law), 3, 3))
    derivative[:, 0, 1] = speed
    derivative[:, 2, 0], derivative[:, 2, 1] = scale * turning, gain * turning
    derivative[:, 1] = -centre[:, None] * derivative[:, 2]
    derivative[:, 1, 2] = -yaw_rate
    return np.stack([scale * speed, -centre * yaw_rate, yaw_rate], axis=1), derivative
