from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from trackslip import se2
from trackslip.kinematics import Array, RobotGeometry, advance
from trackslip.laws.icr import ConstantIcr
from trackslip.localization.pose_estimate import PoseEstimate
from trackslip.online.filter import FilterTuning, IcrFilter, icr_motion

GEOMETRY = RobotGeometry(0.168, 0.06)
TRUE = ConstantIcr(0.045, GEOMETRY.half_gauge, 0.0067)
GAIN = GEOMETRY.half_gauge / (GEOMETRY.half_gauge + TRUE.offset)
NOISE = np.diag([0.002, 0.002, np.radians(0.25)]) ** 2
PERIOD = 0.05
EXACT = FilterTuning(
    gain_walk=0.0, radius_error_walk=0.0, position_walk=0.0, heading_walk=0.0, centre_walk=0.0
)


def variances(covariance):
    """Diagonals (N, n) of covariances (N, n, n)."""
    return np.einsum("nii->ni", covariance)


@dataclass
class Drive:
    """N robots on constant ICRs, whose poses are measured with noise."""

    found: IcrFilter
    pose: Array  # (N, 3) true
    rng: np.random.Generator

    @classmethod
    def begin(
        cls, n: int, law: ConstantIcr | None = None, tuning: FilterTuning | None = None
    ) -> "Drive":
        pose = np.zeros((n, 3))
        return cls(IcrFilter(pose, GEOMETRY, law, tuning), pose, np.random.default_rng(0))

    def run(
        self, seconds: float, omega: tuple[float, float] = (2.0, 2.9), law: ConstantIcr = TRUE
    ) -> None:
        speeds = np.tile(omega, (len(self.pose), 1))
        for _ in range(round(seconds / PERIOD)):
            self.pose = advance(self.pose, law.twist(speeds, GEOMETRY), PERIOD)
            self.found.update(speeds, PERIOD, self.measured())

    def measured(self) -> PoseEstimate:
        n = len(self.pose)
        noise = self.rng.normal(size=(n, 3)) * np.sqrt(np.diag(NOISE))
        covariance = np.tile(NOISE, (n, 1, 1))
        return PoseEstimate(self.pose + noise, covariance, np.ones(n, bool))


def test_motion_and_its_derivatives_by_finite_differences():
    law = np.array([[GAIN, TRUE.radius_error, 0.02]])
    omega = np.array([[1.0, 1.7]])
    velocity, by_law = icr_motion(law, omega, GEOMETRY)
    np.testing.assert_allclose(velocity[:, [0, 2]], TRUE.twist(omega, GEOMETRY), atol=1e-15)
    np.testing.assert_allclose(velocity[:, 1], -0.02 * velocity[:, 2], atol=1e-15)

    h = 1e-6
    for k, step in enumerate(h * np.eye(3)):
        (above,), _ = icr_motion(law + step, omega, GEOMETRY)
        (below,), _ = icr_motion(law - step, omega, GEOMETRY)
        np.testing.assert_allclose(by_law[0, :, k], (above - below) / (2 * h), atol=1e-8)


def test_finds_the_law_and_knows_how_well():
    """Where truth is drawn from what the filter expects, squared errors in its covariance are
    chi-square.
    """
    rng = np.random.default_rng(1)
    tuning = replace(EXACT, gain_spread=0.1, radius_error_spread=0.005)
    gain = 1 + rng.normal(0, 0.1, 150)
    radius_error = rng.normal(0, 0.005, 150)
    offset = GEOMETRY.half_gauge * (1 / gain - 1)
    truth = ConstantIcr(offset, GEOMETRY.half_gauge, radius_error)
    drive = Drive.begin(150, None, tuning)
    for seconds in (2.0, 8.0):
        drive.run(seconds, law=truth)
        error = drive.found.state[:, 3:5] - np.stack([gain, radius_error], axis=1)
        information = np.linalg.inv(drive.found.covariance[:, 3:5, 3:5])
        square = np.einsum("ni,nij,nj->n", error, information, error)
        low, high = chi2.ppf([0.001, 0.999], 2 * len(square))
        assert low < square.sum() < high
    assert drive.found.restarts.sum() <= 1


def test_finds_changed_ground_within_seconds():
    drive = Drive.begin(50, TRUE)
    drive.run(15.0)
    assert not drive.found.restarts.any()
    sticky = ConstantIcr(0.1, GEOMETRY.half_gauge, 0.0067)
    drive.run(5.0, law=sticky)
    assert (drive.found.restarts == 1).all()
    np.testing.assert_allclose(drive.found.offset, 0.1, rtol=0.1)
    drive.run(10.0, law=sticky)
    np.testing.assert_allclose(drive.found.offset, 0.1, rtol=0.03)


def test_a_turn_about_a_shifted_centre_is_no_changed_ground():
    """As with a weight ahead of the middle: D is found all the same."""
    speeds = np.array([[2.0, 2.9]])
    centre = 0.03
    drive = Drive.begin(20, TRUE)
    v, w = TRUE.twist(speeds, GEOMETRY)[0]
    motion = np.tile([v, -centre * w, w], (20, 1)) * PERIOD
    for _ in range(400):
        drive.pose, *_ = se2.drive(drive.pose, motion)
        drive.found.update(np.repeat(speeds, 20, axis=0), PERIOD, drive.measured())
    assert not drive.found.restarts.any()
    np.testing.assert_allclose(drive.found.offset, TRUE.offset, rtol=0.05)
    np.testing.assert_allclose(drive.found.state[:, 5], centre, atol=0.01)


def test_stays_put_when_nothing_is_to_be_learnt():
    """A stand only tells more of the pose, and through it, once, a little of the turn before."""
    drive = Drive.begin(3, TRUE)
    drive.run(10.0)
    known = drive.found.state[:, 3:].copy()
    covariance = drive.found.covariance[:, 3:, 3:].copy()
    drive.run(10.0, omega=(0.0, 0.0))
    change = np.abs(drive.found.state[:, 3:] - known)
    assert (change < np.sqrt(variances(covariance))).all()
    growth = variances(drive.found.covariance[:, 3:, 3:] - covariance)
    assert (growth <= 1e-12).all()

    known_offset = drive.found.offset
    gain = drive.found.state[:, 3]
    # D = b (1 / gain - 1)
    offset_error = GEOMETRY.half_gauge / gain**2 * np.sqrt(drive.found.covariance[:, 3, 3])
    drive.run(10.0, omega=(2.5, 2.5))
    drive.run(10.0, omega=(-2.5, -2.5))
    assert (np.abs(drive.found.offset - known_offset) < offset_error).all()
    assert not drive.found.restarts.any()


def test_wrong_poses_are_left_out_and_carried_robots_found_again():
    drive = Drive.begin(2, TRUE)
    drive.run(10.0)
    before = drive.found.state.copy()
    estimate = drive.measured()
    estimate.pose[0] += [0.3, 0.0, 0.0]
    estimate.pose[1] += [0.0, 0.0, 0.5]
    drive.found.update(np.zeros((2, 2)), PERIOD, estimate)
    np.testing.assert_array_equal(drive.found.state, before)
    drive.pose = drive.pose + np.array([1.0, -1.0, 0.5])
    drive.run(10.0)
    np.testing.assert_allclose(drive.found.state[:, :3], drive.pose, atol=0.01)
    np.testing.assert_allclose(drive.found.offset, TRUE.offset, rtol=0.1)
