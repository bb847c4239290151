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
ERRORS = LawErrors(
    ("offset", "radius_error"), np.outer((1e-3, 4e-3), (1e-3, 4e-3)) * [[1, 0.6], [0.6, 1]]
)
RATE = 50.0
GYRO = Gyro(0.01, 0.02, 1e-3, 1e-3, 5e-3, -0.1)


def driving(seed, duration=30.0):
    speeds = track_commands("random", duration, RATE, Driver(), np.random.default_rng(seed))
    return np.arange(len(speeds)) / RATE, speeds / GEOMETRY.sprocket_radius


def nees(error, covariance):
    return np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)


def test_arcs_are_exact():
    """A steady circle, however coarse its rows, is that of the closed form."""
    twist = np.array([0.2, 0.5])
    omega = ICR.sprocket_speeds(twist, GEOMETRY)
    for time in (np.array([0.0, 10.0]), np.array([0.0, 0.3, 7.0, 10.0]), np.arange(1001) / 100):
        path = SlipOdometry(ICR, GEOMETRY, start=(1.0, 2.0, 0.3)).path(
            time, np.tile(omega, (len(time), 1))
        )
        np.testing.assert_allclose(path.pose, advance([1.0, 2.0, 0.3], twist, time), atol=1e-12)


@pytest.mark.parametrize(
    ("law", "gyro"),
    [(ICR, None), (ICR, GYRO), (TurnLoss(0.04, 0.168, 0.01, 0.2), None), (PUBLISHED, None)],
)
def test_step_by_step_is_the_same_as_the_whole_log(law, gyro):
    time, omega = driving(0, 6.0)
    turned = np.where((time > 0.5) & (time < 1.5), np.nan, omega @ [-0.2, 0.2])
    errors = ERRORS if isinstance(law, ConstantIcr | TurnLoss) else None
    odometry = SlipOdometry(
        law, GEOMETRY, NOISE, errors, drift=0.02, start=(1.0, 2.0, 1.0), gyro=gyro
    )
    whole = odometry.path(time, omega, turned)
    for k in range(1, 101):
        odometry.update(omega[k], time[k] - time[k - 1], turned[k])
    rest = odometry.path(time[100:], omega[100:], turned[100:])
    # whose twists are iterated until all rows have converged to 1e-12
    exactly = law is not PUBLISHED
    np.testing.assert_allclose(rest.pose, whole.pose[100:], rtol=0, atol=0 if exactly else 1e-12)
    np.testing.assert_allclose(
        rest.covariance, whole.covariance[100:], rtol=0, atol=0 if exactly else 1e-12
    )


def test_many_robots_are_independent_bit_by_bit():
    runs = [driving(seed, 4.0) for seed in range(3)]
    time, omega = runs[0][0], np.stack([run[1] for run in runs], axis=1)
    starts = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0], [-1.0, 0.5, 0.0]])
    gyro = np.column_stack(
        [0.1 * omega[:, 0, 0], np.full(len(time), np.nan), 0.05 * omega[:, 2, 1]]
    )
    fleet = SlipOdometry(ICR, GEOMETRY, NOISE, ERRORS, start=starts, gyro=Gyro()).path(
        time, omega, gyro
    )
    for k, start in enumerate(starts):
        odometry = SlipOdometry(ICR, GEOMETRY, NOISE, ERRORS, start=start, gyro=Gyro())
        alone = odometry.path(time, omega[:, k], gyro[:, k])
        np.testing.assert_array_equal(fleet.pose[:, k], alone.pose)
        np.testing.assert_array_equal(fleet.covariance[:, k], alone.covariance)


def test_on_a_straight_line_headings_are_a_random_walk():
    """After a way L, the heading's variance is q L, its covariance with y is q L^2 / 2, and y adds
    q L^3 / 3.
    """
    omega = NoSlip().sprocket_speeds([0.5, 0.0], GEOMETRY)
    for rows in (2, 3, 101):
        time = np.linspace(0.0, 8.0, rows)
        path = SlipOdometry(NoSlip(), GEOMETRY, SlipNoise(0.01, 0.02, 0.03)).path(
            time, np.tile(omega, (rows, 1))
        )
        way, q = 4.0, 0.03**2
        across, both = 0.02**2 * way + q * way**3 / 3, q * way**2 / 2
        expected = [[0.01**2 * way, 0, 0], [0, across, both], [0, both, q * way]]
        np.testing.assert_allclose(path.covariance[-1], expected, rtol=1e-12, atol=1e-18)
    omega = NoSlip().sprocket_speeds([0.5, 0.4], GEOMETRY)
    path = SlipOdometry(NoSlip(), GEOMETRY, SlipNoise(0.01)).path([0.0, 2.0], [omega, omega])
    # an arc is symmetric about the middle of its chord
    across = np.array([-path.pose[-1, 1], path.pose[-1, 0]])
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
    columns = [(end(start + step) - end(start - step)) / (2 * h) for step in h * np.eye(3)]
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
    path = SlipOdometry(law, GEOMETRY, errors=LawErrors(names, covariance), drift=0.03).path(
        time, omega
    )

    def end(name, step):
        changed = replace(law, **{name: getattr(law, name) + step})
        return SlipOdometry(changed, GEOMETRY, drift=0.03).path(time, omega).pose[-1]

    slope = np.stack([(end(name, 1e-5) - end(name, -1e-5)) / 2e-5 for name in names], axis=1)
    np.testing.assert_allclose(path.covariance[-1], slope @ covariance @ slope.T, rtol=1e-5)


def test_unknown_parameters_are_covered():
    """Robots whose D and epsilon differ from those of the law by their errors, and slip besides."""
    time, omega = driving(5, 20.0)
    path = SlipOdometry(ICR, GEOMETRY, NOISE, ERRORS).path(time, omega)
    without = SlipOdometry(ICR, GEOMETRY, NOISE).path(time, omega)
    rng = np.random.default_rng(1)
    ends = []
    for offset, error in rng.multivariate_normal(
        [ICR.offset, ICR.radius_error], ERRORS.covariance, 400
    ):
        law = ConstantIcr(offset, ICR.half_gauge, error)
        ends.append(LawMotion(law, GEOMETRY, WHITE).drive(omega, RATE, rng)[0].pose[-1])
    error = np.array(ends) - path.pose[-1]
    found = nees(error, np.broadcast_to(path.covariance[-1], (len(ends), 3, 3)))
    assert abs(found.mean() - 3) < 3.5 * np.sqrt(6 / len(ends))
    overconfident = nees(error, np.broadcast_to(without.covariance[-1], (len(ends), 3, 3)))
    assert overconfident.mean() > 4


def test_an_outward_drift_is_that_of_the_simulator():
    time, omega = driving(6, 20.0)
    motion, _ = LawMotion(ICR, GEOMETRY, STILL, drift=0.05).drive(
        omega, RATE, np.random.default_rng(0)
    )
    path = SlipOdometry(ICR, GEOMETRY, drift=0.05).path(time, omega)
    np.testing.assert_allclose(path.pose, motion.at(time), atol=1e-9)


TIME = 0.02 * np.arange(1501)


def readings(rate, gyro=GYRO):
    """Readings (...) of a gyro with these errors, without noise, at yaw rates (...)."""
    return rate * (1 + gyro.scale) + gyro.bias


def test_the_turn_is_the_gyros_and_the_speed_the_laws():
    omega = np.tile(ICR.sprocket_speeds([0.2, 0.3], GEOMETRY), (len(TIME), 1))
    path = SlipOdometry(ICR, GEOMETRY, gyro=GYRO).path(
        TIME, omega, np.full(len(TIME), readings(0.5))
    )
    exact = SlipOdometry(ICR, GEOMETRY).path(
        TIME, np.tile(ICR.sprocket_speeds([0.2, 0.5], GEOMETRY), (len(TIME), 1))
    )
    np.testing.assert_allclose(path.pose, exact.pose, atol=1e-9)


def test_at_rest_it_learns_the_bias():
    """A minute at rest, then a spin: the heading is off by less than a tenth of what another bias
    would make it.
    """
    bias, omega = 0.03, np.zeros((6001, 2))
    time = 0.02 * np.arange(6001)
    omega[3001:] = ICR.sprocket_speeds([0.0, 0.5], GEOMETRY)
    turned = np.where(np.arange(6001) > 3000, 0.5, 0.0) + bias
    path = SlipOdometry(ICR, GEOMETRY, gyro=Gyro(bias=0.01)).path(time, omega, turned)
    np.testing.assert_allclose(path.pose[:3001, 2], 0.0, atol=1e-12)
    assert abs(path.pose[-1, 2] - 30.0) < 0.1 * (bias - 0.01) * 60
    assert path.covariance[-1, 2, 2] == 0.0  # of a gyro without errors


def test_the_variance_of_the_heading_is_that_of_a_gyro():
    omega = np.tile(ICR.sprocket_speeds([0.2, 0.0], GEOMETRY), (len(TIME), 1))
    for rate in (0.0, 0.4):
        path = SlipOdometry(ICR, GEOMETRY, NOISE, ERRORS, gyro=GYRO).path(
            TIME, omega, readings(rate) + 0 * TIME
        )
        time = TIME[-1]
        expected = (
            GYRO.noise**2 * time
            + (GYRO.bias_error * time) ** 2
            + (GYRO.scale_error * time * rate) ** 2
        )
        assert path.covariance[-1, 2, 2] == pytest.approx(
            expected / (1 + GYRO.scale) ** 2, rel=1e-9
        )


def test_on_slip_that_lasts_it_is_far_better():
    log = drive_log(2, 60.0, variation=SlipVariation(lasting=0.02))
    rate = np.append(0.0, np.diff(log.truth.pose[:, 2]) / np.diff(log.time))
    late = np.interp(log.time - 0.1, log.time, readings(rate))
    truth = replace(log, pose=log.truth.pose, valid=None, gyro=late)
    plain, gyro = (
        odometry_errors(truth, SlipOdometry(ICR, GEOMETRY, gyro=one)).after_seconds[10.0]
        for one in (None, replace(GYRO, clock=0.1))
    )
    assert gyro.heading.rms < 0.2 * plain.heading.rms
    assert gyro.position.rms < 0.75 * plain.position.rms
