from dataclasses import replace

import numpy as np
import pytest
from drives import GEOMETRY, ICR, drive_log
from law_motion import STILL, WHITE, LawMotion, SlipVariation

from sim.wander.motion import Driver, track_commands
from trackslip.kinematics import advance
from trackslip.laws.base import NoSlip
from trackslip.laws.exponential import PUBLISHED
from trackslip.laws.icr import ConstantIcr
from trackslip.laws.turn_loss import Centrifugal, TurnLoss
from trackslip.odometry.evaluation import odometry_errors
from trackslip.odometry.slip_odometry import SlipOdometry
from trackslip.odometry.uncertainty import Gyro, LawErrors, SlipNoise

NOISE = SlipNoise(WHITE.along, WHITE.across, WHITE.turning)
STANDARD_ERRORS = (1e-3, 4e-3)
CORRELATION = np.array([[1, 0.6], [0.6, 1]])
ERRORS = LawErrors(
    ("offset", "radius_error"), np.outer(STANDARD_ERRORS, STANDARD_ERRORS) * CORRELATION
)
RATE = 50.0  # of the encoders [Hz]
GYRO = Gyro(bias=0.01, scale=0.02, noise=1e-3, bias_error=1e-3, scale_error=5e-3, clock=-0.1)


def driving(seed, duration=30.0):
    """Times (T,) [s] and sprocket speeds (T, 2) [rad/s] of a random drive."""
    speeds = track_commands("random", duration, RATE, Driver(), np.random.default_rng(seed))
    time = np.arange(len(speeds)) / RATE
    return time, speeds / GEOMETRY.sprocket_radius


def steadily(twist, rows, law=ICR):
    """Sprocket speeds (rows, 2) of a steady drive."""
    return np.tile(law.sprocket_speeds(twist, GEOMETRY), (rows, 1))


def nees(error, covariance):
    """Normalised estimation errors squared (n,) of errors (n, 3)."""
    return np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)


def test_arcs_are_exact():
    """A steady circle, however coarse its rows, is that of the closed form."""
    twist = np.array([0.2, 0.5])
    start = (1.0, 2.0, 0.3)
    for time in (np.array([0.0, 10.0]), np.array([0.0, 0.3, 7.0, 10.0]), np.arange(1001) / 100):
        odometry = SlipOdometry(ICR, GEOMETRY, start=start)
        path = odometry.path(time, steadily(twist, len(time)))
        np.testing.assert_allclose(path.pose, advance(start, twist, time), atol=1e-12)


@pytest.mark.parametrize(
    ("law", "gyro"),
    [(ICR, None), (ICR, GYRO), (TurnLoss(0.04, 0.168, 0.01, 0.2), None), (PUBLISHED, None)],
)
def test_step_by_step_is_the_same_as_the_whole_log(law, gyro):
    time, omega = driving(0, 6.0)
    without_gyro = (time > 0.5) & (time < 1.5)
    turned = np.where(without_gyro, np.nan, omega @ [-0.2, 0.2])
    errors = ERRORS if isinstance(law, ConstantIcr | TurnLoss) else None
    start = (1.0, 2.0, 1.0)
    odometry = SlipOdometry(law, GEOMETRY, NOISE, errors, drift=0.02, start=start, gyro=gyro)
    whole = odometry.path(time, omega, turned)
    for k in range(1, 101):
        odometry.update(omega[k], time[k] - time[k - 1], turned[k])
    rest = odometry.path(time[100:], omega[100:], turned[100:])
    # twists of the published law are iterated until all rows have converged to 1e-12
    tolerance = 1e-12 if law is PUBLISHED else 0
    np.testing.assert_allclose(rest.pose, whole.pose[100:], rtol=0, atol=tolerance)
    np.testing.assert_allclose(rest.covariance, whole.covariance[100:], rtol=0, atol=tolerance)


def test_many_robots_are_independent_bit_by_bit():
    runs = [driving(seed, 4.0) for seed in range(3)]
    time, _ = runs[0]
    omega = np.stack([speeds for _, speeds in runs], axis=1)
    starts = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0], [-1.0, 0.5, 0.0]])
    no_gyro = np.full(len(time), np.nan)
    gyro = np.column_stack([0.1 * omega[:, 0, 0], no_gyro, 0.05 * omega[:, 2, 1]])
    together = SlipOdometry(ICR, GEOMETRY, NOISE, ERRORS, start=starts, gyro=Gyro())
    fleet = together.path(time, omega, gyro)
    for k, start in enumerate(starts):
        odometry = SlipOdometry(ICR, GEOMETRY, NOISE, ERRORS, start=start, gyro=Gyro())
        alone = odometry.path(time, omega[:, k], gyro[:, k])
        np.testing.assert_array_equal(fleet.pose[:, k], alone.pose)
        np.testing.assert_array_equal(fleet.covariance[:, k], alone.covariance)


def test_on_a_straight_line_headings_are_a_random_walk():
    """After a way L, the heading's variance is q L, its covariance with y is q L^2 / 2, and y adds
    q L^3 / 3.
    """
    speed = 0.5
    forwards = 0.01
    sideways = 0.02
    turning = 0.03
    noise = SlipNoise(forwards, sideways, turning)
    for rows in (2, 3, 101):
        time = np.linspace(0.0, 8.0, rows)
        omega = steadily([speed, 0.0], rows, NoSlip())
        path = SlipOdometry(NoSlip(), GEOMETRY, noise).path(time, omega)
        way = speed * 8.0
        q = turning**2
        along = forwards**2 * way
        across = sideways**2 * way + q * way**3 / 3
        both = q * way**2 / 2
        expected = [[along, 0, 0], [0, across, both], [0, both, q * way]]
        np.testing.assert_allclose(path.covariance[-1], expected, rtol=1e-12, atol=1e-18)

    # slip along an arc lies along its chord, about whose middle the arc is symmetric
    omega = steadily([0.5, 0.4], 2, NoSlip())
    path = SlipOdometry(NoSlip(), GEOMETRY, SlipNoise(0.01)).path([0.0, 2.0], omega)
    x, y, _ = path.pose[-1]
    across = np.array([-y, x])
    np.testing.assert_allclose(path.covariance[-1, :2, :2] @ across, 0.0, atol=1e-18)


def test_the_covariance_at_the_start_is_carried_along():
    """By the derivative of the end by the start, which differences show."""
    time, omega = driving(2, 10.0)
    start = np.array([2.0, -1.0, 0.7])
    spread = np.diag([0.1, 0.2, 0.05]) ** 2
    path = SlipOdometry(ICR, GEOMETRY, start=start, start_covariance=spread).path(time, omega)

    def end(pose):
        return SlipOdometry(ICR, GEOMETRY, start=pose).path(time, omega).pose[-1]

    h = 1e-6
    columns = []
    for step in h * np.eye(3):
        columns.append((end(start + step) - end(start - step)) / (2 * h))
    slope = np.stack(columns, axis=1)
    np.testing.assert_allclose(path.covariance[-1], slope @ spread @ slope.T, rtol=1e-7)


@pytest.mark.parametrize(
    ("law", "names"),
    [
        (ICR, ("offset", "radius_error")),
        (TurnLoss(0.04, 0.168, 0.01, 0.2), ("offset", "radius_error", "turn_loss")),
        (Centrifugal(0.04, 0.168, 0.01, 0.2, 0.0), ("offset", "centrifugal_slip")),
        (PUBLISHED, ("alpha_outer", "beta_outer")),
    ],
)
def test_errors_of_the_law_are_the_same_along_the_whole_way(law, names):
    """The derivatives of the end by the parameters, which differences show, times their
    covariance.
    """
    time, omega = driving(3, 10.0)
    covariance = np.diag(np.linspace(1e-3, 2e-3, len(names))) ** 2
    errors = LawErrors(names, covariance)
    path = SlipOdometry(law, GEOMETRY, errors=errors, drift=0.03).path(time, omega)

    def end(name, step):
        changed = replace(law, **{name: getattr(law, name) + step})
        return SlipOdometry(changed, GEOMETRY, drift=0.03).path(time, omega).pose[-1]

    h = 1e-5
    columns = []
    for name in names:
        columns.append((end(name, h) - end(name, -h)) / (2 * h))
    slope = np.stack(columns, axis=1)
    np.testing.assert_allclose(path.covariance[-1], slope @ covariance @ slope.T, rtol=1e-5)


def test_unknown_parameters_are_covered():
    """Robots whose D and epsilon differ from those of the law by their errors, and slip besides."""
    time, omega = driving(5, 20.0)
    path = SlipOdometry(ICR, GEOMETRY, NOISE, ERRORS).path(time, omega)
    without = SlipOdometry(ICR, GEOMETRY, NOISE).path(time, omega)
    rng = np.random.default_rng(1)
    truth = [ICR.offset, ICR.radius_error]
    drawn = rng.multivariate_normal(truth, ERRORS.covariance, 400)
    ends = []
    for offset, radius_error in drawn:
        robot = LawMotion(ConstantIcr(offset, ICR.half_gauge, radius_error), GEOMETRY, WHITE)
        motion, _ = robot.drive(omega, RATE, rng)
        ends.append(motion.pose[-1])
    error = np.array(ends) - path.pose[-1]

    def normalised(covariance):
        return nees(error, np.broadcast_to(covariance, (len(ends), 3, 3)))

    found = normalised(path.covariance[-1])
    assert abs(found.mean() - 3) < 3.5 * np.sqrt(6 / len(ends))  # as a chi squared's mean of 3
    overconfident = normalised(without.covariance[-1])
    assert overconfident.mean() > 4


def test_an_outward_drift_is_that_of_the_simulator():
    time, omega = driving(6, 20.0)
    robot = LawMotion(ICR, GEOMETRY, STILL, drift=0.05)
    motion, _ = robot.drive(omega, RATE, np.random.default_rng(0))
    path = SlipOdometry(ICR, GEOMETRY, drift=0.05).path(time, omega)
    np.testing.assert_allclose(path.pose, motion.at(time), atol=1e-9)


TIME = 0.02 * np.arange(1501)


def readings(rate, gyro=GYRO):
    """Readings (...) of a gyro with these errors, without noise, at yaw rates (...)."""
    return rate * (1 + gyro.scale) + gyro.bias


def test_the_turn_is_the_gyros_and_the_speed_the_laws():
    omega = steadily([0.2, 0.3], len(TIME))
    turned = np.full(len(TIME), readings(0.5))
    path = SlipOdometry(ICR, GEOMETRY, gyro=GYRO).path(TIME, omega, turned)
    exact = SlipOdometry(ICR, GEOMETRY).path(TIME, steadily([0.2, 0.5], len(TIME)))
    np.testing.assert_allclose(path.pose, exact.pose, atol=1e-9)


def test_at_rest_it_learns_the_bias():
    """A minute at rest, then a spin: the heading is off by less than a tenth of what another bias
    would make it.
    """
    bias = 0.03
    assumed_bias = 0.01
    row = np.arange(6001)
    time = 0.02 * row
    spins = row > 3000
    omega = np.where(spins[:, None], ICR.sprocket_speeds([0.0, 0.5], GEOMETRY), 0.0)
    turned = np.where(spins, 0.5, 0.0) + bias
    path = SlipOdometry(ICR, GEOMETRY, gyro=Gyro(bias=assumed_bias)).path(time, omega, turned)
    np.testing.assert_allclose(path.pose[:3001, 2], 0.0, atol=1e-12)
    unlearnt = (bias - assumed_bias) * 60
    assert abs(path.pose[-1, 2] - 30.0) < 0.1 * unlearnt
    assert path.covariance[-1, 2, 2] == 0.0  # of a gyro without errors


def test_the_variance_of_the_heading_is_that_of_a_gyro():
    omega = steadily([0.2, 0.0], len(TIME))
    time = TIME[-1]
    for rate in (0.0, 0.4):
        odometry = SlipOdometry(ICR, GEOMETRY, NOISE, ERRORS, gyro=GYRO)
        path = odometry.path(TIME, omega, readings(rate) + 0 * TIME)
        by_noise = GYRO.noise**2 * time
        by_bias = (GYRO.bias_error * time) ** 2
        by_scale = (GYRO.scale_error * time * rate) ** 2
        expected = (by_noise + by_bias + by_scale) / (1 + GYRO.scale) ** 2
        assert path.covariance[-1, 2, 2] == pytest.approx(expected, rel=1e-9)


def test_on_slip_that_lasts_it_is_far_better():
    log = drive_log(2, 60.0, variation=SlipVariation(lasting=0.02))
    rate = np.append(0.0, np.diff(log.truth.pose[:, 2]) / np.diff(log.time))
    late = np.interp(log.time - 0.1, log.time, readings(rate))
    truth = replace(log, pose=log.truth.pose, valid=None, gyro=late)

    def errors_with(gyro):
        odometry = SlipOdometry(ICR, GEOMETRY, gyro=gyro)
        return odometry_errors(truth, odometry).after_seconds[10.0]

    plain = errors_with(None)
    gyro = errors_with(replace(GYRO, clock=0.1))
    assert gyro.heading.rms < 0.2 * plain.heading.rms
    assert gyro.position.rms < 0.75 * plain.position.rms
