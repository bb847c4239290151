"""Online slip estimation: an extended Kalman filter for the pose and constant ICRs.

Between two scans the encoders measure the distances that the belts move. With constant ICRs, which
have the constants D and epsilon, the robot drives an arc:

    v = (1 + epsilon) (s_r + s_l) / 2
    w = (1 + epsilon) g (s_r - s_l) / (2 b)
    g = b / (b + D)

with belt speeds s = r omega. The turning centre is not always beside the robot's centre: with the
centre of mass ahead, or when a fast robot skids on slippery ground, it is ahead by c, and the
robot's centre drifts sideways at -c w. Identification from whole drives tells both causes apart:
there, the place of the turning centre is part of `sensor_x`, and a `drift` d [s] adds d v to c. The
filter's c is their sum at the present speed, so it has to learn anew when a robot that drifts
reverses. A scan measures the pose. The state is (x, y, phi, g,
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
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from trackslip import se2
from trackslip.arguments import checks_arguments
from trackslip.kinematics import Array, RobotGeometry, wrap_angle
from trackslip.laws.icr import ConstantIcr
from trackslip.localization.pose_estimate import PoseEstimate
from trackslip.odometry.uncertainty import LawErrors
from trackslip.restorable import Restorable

# limits on the constants: g [-], epsilon [-] and c [m]
_MIN_CONSTANTS: Final = np.array([0.05, -0.5, -1.0])
_MAX_CONSTANTS: Final = np.array([10.0, 0.5, 1.0])
_KNOWN_LAW_SHARE: Final = 0.15  # factor on the initial spreads after the start from a known law [-]
_MIN_YAW_RATE: Final = 0.015  # mean yaw rate above which g and c are updated [rad/s]
# standard deviation added to that of a measured pose, in quadrature [m, rad]
_POSE_FLOOR: Final = 1e-4
# normalised squared innovation above which a pose is rejected (chi-square, 3 degrees of freedom)
_OUTLIER_GATE: Final = 30.0
_MAX_REJECTIONS: Final = 5  # number of rejections in a row after which the filter restarts
# normalised squared mean innovation of changed ground (chi-square, 3 degrees of freedom)
_CHANGE_GATE: Final = 60.0
_TIME_CONSTANT: Final = 10.0  # of the mean innovation and yaw rate [scans]


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


@checks_arguments
class IcrFilter(Restorable):
    """Extended Kalman filter for the poses, D and epsilon of N independent robots."""

    STATE = (
        "state",
        "covariance",
        "restarts",
        "_bias",
        "_bias_variance",
        "_rejections",
        "_yaw_rate",
    )

    def __init__(
        self,
        start: ArrayLike,
        geometry: RobotGeometry,
        law: ConstantIcr | None = None,
        tuning: FilterTuning | None = None,
    ) -> None:
        """Start at known poses (N, 3) with D and epsilon of `law`, both 0 without a law."""
        self._geometry = geometry
        self._tuning = tuning or FilterTuning()
        pose = np.atleast_2d(np.asarray(start, float))
        n = len(pose)

        # initial values (N, 3) and standard deviations (3,) of g, epsilon and c
        self._prior = np.tile([1.0, 0.0, 0.0], (n, 1))
        self._spreads = np.array(
            [
                self._tuning.gain_spread,
                self._tuning.radius_error_spread,
                self._tuning.centre_spread,
            ]
        )
        self._share = 1.0  # factor on the initial standard deviations at the start of a run
        if law is not None:
            self._prior[:, 0] = geometry.half_gauge / (geometry.half_gauge + law.offset)
            self._prior[:, 1] = law.radius_error
            self._share = _KNOWN_LAW_SHARE

        self.state = np.zeros((n, 6))
        """States (N, 6): x, y [m], phi [rad], g, epsilon [-], c [m]."""
        self.covariance = np.zeros((n, 6, 6))
        """Covariances (N, 6, 6) of the state."""
        self.restarts = np.zeros(n, int)
        """Numbers of restarts (N,)."""
        self._yaw_rate = np.zeros(n)  # recent mean [rad/s]
        self._bias = np.zeros((n, 3))  # exponentially weighted sum of whitened innovations
        self._bias_variance = np.zeros(n)  # of each of its components, if the filter is right
        self._rejections = np.zeros(n, int)  # number of poses rejected in a row
        self.start(np.arange(n), pose)

    def start(self, robots: np.ndarray, pose: Array) -> None:
        """Restart the robots with indices `robots` (R,) at known poses (R, 3)."""
        self.state[robots, 3:] = self._prior[robots]
        self.restarts[robots] = 0
        self._yaw_rate[robots] = 0.0
        exact = np.zeros((len(robots), 3, 3))
        self._begin(robots, pose, exact, self._share)

    @property
    def law(self) -> ConstantIcr:
        """Slip law with the current estimates, whose parameters are (N,)."""
        radius_error = self.state[:, 4].copy()
        return ConstantIcr(self.offset, self._geometry.half_gauge, radius_error)  # type: ignore[arg-type]

    @property
    def offset(self) -> Array:
        """Estimates of D (N,) [m]."""
        return self._geometry.half_gauge * (1 / self.state[:, 3] - 1)

    @property
    def law_errors(self) -> LawErrors:
        """Errors of D and epsilon, with covariances (N, 2, 2).

        As D = b (1 / g - 1), an error of g is -b / g^2 times as large in D.
        """
        by_gain = -self._geometry.half_gauge / self.state[:, 3] ** 2
        scale = np.stack([by_gain, np.ones_like(by_gain)], axis=1)
        covariance = scale[:, :, None] * self.covariance[:, 3:5, 3:5] * scale[:, None, :]
        return LawErrors(("offset", "radius_error"), covariance)

    def velocity(self, omega: Array) -> Array:
        """Velocities (N, 3) (forwards, leftwards, yaw) at sprocket speeds (N, 2) [rad/s]."""
        return icr_motion(self.state[:, 3:], omega, self._geometry)[0]

    def update(
        self, omega: Array, duration: float, estimate: PoseEstimate, known: Array | None = None
    ) -> None:
        """Process mean sprocket speeds (N, 2) [rad/s] over `duration` [s] and poses afterwards.

        Velocities `known` (N, 3) (forwards, leftwards, yaw) are added to the velocities from the
        constant ICRs.
        """
        self._predict(omega, duration, known)
        rows = np.flatnonzero(estimate.valid)
        if rows.size:
            self._correct(rows, estimate.pose[rows], estimate.covariance[rows])

    def _predict(self, omega: Array, duration: float, known: Array | None) -> None:
        """Move the states, and let the covariances grow, for sprocket speeds (N, 2) [rad/s].

        With F = d state / d (previous state) and the noise Q, the covariance becomes F P F' + Q.
        The pose depends on the constants through the motion: d pose / d constants = (d pose / d
        motion) (d motion / d constants).
        """
        velocity, velocity_by_constants = icr_motion(self.state[:, 3:], omega, self._geometry)
        if known is not None:
            velocity = velocity + known
        motion = velocity * duration
        motion_by_constants = velocity_by_constants * duration
        pose, pose_by_pose, pose_by_motion = se2.drive(self.state[:, :3], motion)
        self.state[:, :3] = pose

        jacobian = np.zeros_like(self.covariance)
        jacobian[:, :3, :3] = pose_by_pose
        jacobian[:, :3, 3:] = np.einsum("nij,njk->nik", pose_by_motion, motion_by_constants)
        jacobian[:, [3, 4, 5], [3, 4, 5]] = 1.0  # the constants stay
        self.covariance = np.einsum("nij,njk,nlk->nil", jacobian, self.covariance, jacobian)
        self.covariance[:, np.arange(6), np.arange(6)] += self._noise(motion)
        self._limit_spreads()
        self._yaw_rate += (velocity[:, 2] - self._yaw_rate) / _TIME_CONSTANT

    def _noise(self, motion: Array) -> Array:
        """Variances (N, 6) that motions (N, 3) add to the state, in proportion to their lengths."""
        driven = np.abs(motion[:, 0])
        turned = np.abs(motion[:, 2])
        tuning = self._tuning
        lengths_and_walks = (
            (driven, tuning.position_walk),
            (driven, tuning.position_walk),
            (driven + turned, tuning.heading_walk),
            (turned, tuning.gain_walk),
            (driven, tuning.radius_error_walk),
            (turned, tuning.centre_walk),
        )
        return np.stack([length * np.square(walk) for length, walk in lengths_and_walks], axis=1)

    def _limit_spreads(self) -> None:
        """Keep the constants from becoming more uncertain than without prior knowledge."""
        for k, limit in enumerate(self._spreads, 3):
            variance = self.covariance[:, k, k]
            shrinkage = np.where(variance > limit**2, limit / np.sqrt(variance), 1.0)
            # of rows and columns, so that correlations stay
            self.covariance[:, k, :] *= shrinkage[:, None]
            self.covariance[:, :, k] *= shrinkage[:, None]

    def _correct(self, rows: np.ndarray, pose: Array, noise: Array) -> None:
        """Update robots `rows` (R,) by poses (R, 3) with covariances `noise` (R, 3, 3).

        The innovation, measured minus estimated pose, has the covariance S = P_pose + noise. With S
        = L L', the whitened innovation L^-1 (measured - estimated) has independent components of
        variance 1, whose sum of squares both gates limit.
        """
        innovation = pose - self.state[rows, :3]
        innovation[:, 2] = wrap_angle(innovation[:, 2])
        noise = noise + _POSE_FLOOR**2 * np.eye(3)
        covariance = self.covariance[rows, :3, :3] + noise  # S
        root = np.linalg.cholesky((covariance + covariance.swapaxes(1, 2)) / 2)  # L
        white = np.linalg.solve(root, innovation[..., None])[..., 0]

        # poses too far away for scan noise are not used
        is_outlier = _squared(white) > _OUTLIER_GATE
        self._rejections[rows] = np.where(is_outlier, self._rejections[rows] + 1, 0)
        used = np.flatnonzero(~is_outlier)
        self._learn(rows[used], white[used], root[used])

        # after changed ground or many outliers, the filter starts again
        bias_variance = np.maximum(self._bias_variance[rows], 1.0)  # 0 before the first pose
        has_changed = _squared(self._bias[rows]) > _CHANGE_GATE * bias_variance
        is_lost = self._rejections[rows] >= _MAX_REJECTIONS
        again = has_changed | is_lost
        self.restarts[rows[again]] += 1
        self._begin(rows[again], pose[again], noise[again], share=1.0)

    def _learn(self, rows: np.ndarray, white: Array, root: Array) -> None:
        """Update robots `rows` (R,) by innovations `white` (R, 3), whitened by `root` (R, 3, 3).

        With the root L of an innovation's covariance, and the covariance C (6, 3) of the state with
        the pose, Kalman's gain on the whitened innovation is G = C L'^-1. For another gain K in
        place of G, the covariance of the state becomes P - K G' - G K' + K K' (Joseph's form). The
        rows of K are those of G, or 0 for constants that are not updated.
        """
        optimal = np.linalg.solve(root, self.covariance[rows, :3, :]).swapaxes(1, 2)  # G (R, 6, 3)
        gain = optimal.copy()
        is_slow = np.abs(self._yaw_rate[rows]) < _MIN_YAW_RATE
        gain[np.ix_(is_slow, [3, 5])] = 0.0  # g and c are considered but not updated

        self.state[rows] += np.einsum("nij,nj->ni", gain, white)
        self.state[rows, 3:] = np.clip(self.state[rows, 3:], _MIN_CONSTANTS, _MAX_CONSTANTS)

        cross = np.einsum("nik,njk->nij", gain, optimal)  # K G'
        covariance = self.covariance[rows] - cross - cross.swapaxes(1, 2)
        covariance += np.einsum("nik,njk->nij", gain, gain)
        self.covariance[rows] = (covariance + covariance.swapaxes(1, 2)) / 2

        # older innovations count less: by 1 / e after the time constant
        fade = 1 - 1 / _TIME_CONSTANT
        self._bias[rows] = fade * self._bias[rows] + white
        self._bias_variance[rows] = fade**2 * self._bias_variance[rows] + 1

    def _begin(self, rows: np.ndarray, pose: Array, noise: Array, share: float) -> None:
        """Begin at poses (R, 3) of covariances `noise` (R, 3, 3), with `share` of initial spreads.

        The constants keep their values.
        """
        self.state[rows, :3] = pose
        covariance = np.zeros((len(rows), 6, 6))
        covariance[:, :3, :3] = noise
        covariance[:, 3:, 3:] = np.diag((share * self._spreads) ** 2)
        self.covariance[rows] = covariance
        self._bias[rows] = 0.0
        self._bias_variance[rows] = 0.0
        self._rejections[rows] = 0


def _squared(vectors: Array) -> Array:
    """Squared lengths (R,) of vectors (R, 3)."""
    return np.einsum("ni,ni->n", vectors, vectors)


def icr_motion(constants: Array, omega: Array, geometry: RobotGeometry) -> tuple[Array, Array]:
    """Velocities (N, 3) and their derivatives (N, 3, 3) at sprocket speeds omega (N, 2) [rad/s].

    A velocity is (forward speed, lateral speed to the left, yaw rate). The derivatives are by the
    constants (g, epsilon, c) (N, 3). With the belts' mean speed s and the yaw rate W without slip,

        v = (1 + epsilon) s        u = -c w        w = (1 + epsilon) g W
    """
    gain, radius_error, centre = constants.T
    scale = 1 + radius_error
    left, right = (geometry.sprocket_radius * omega).T
    speed = (right + left) / 2
    ideal_yaw_rate = (right - left) / (2 * geometry.half_gauge)
    yaw_rate = scale * gain * ideal_yaw_rate
    velocity = np.stack([scale * speed, -centre * yaw_rate, yaw_rate], axis=1)

    derivative = np.zeros((len(constants), 3, 3))
    # v
    derivative[:, 0, 1] = speed
    # w
    derivative[:, 2, 0] = scale * ideal_yaw_rate
    derivative[:, 2, 1] = gain * ideal_yaw_rate
    # u
    derivative[:, 1] = -centre[:, None] * derivative[:, 2]
    derivative[:, 1, 2] = -yaw_rate
    return velocity, derivative
