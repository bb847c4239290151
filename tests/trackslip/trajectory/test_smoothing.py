import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from quadrature import integral_miss
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize
from scipy.spatial import cKDTree

from trackslip.errors import InvalidValueError
from trackslip.trajectory.named import REFERENCES
from trackslip.trajectory.path import LIMITS, MotionLimits
from trackslip.trajectory.smoothing import Ends, smoothed
from trackslip.trajectory.waypoints import TOLERANCE, waypoints

RAMPS = LIMITS.speed / LIMITS.acceleration  # time that a start and a stop cost on a straight [s]


MET = 3e-4  # distance to the nearest sample of a reference that meets a point [m]


def noisy(points, sigma, seed=0):
    return points + sigma * np.random.default_rng(seed).standard_normal(np.shape(points))


def straight(length, spacing):
    x = np.arange(0.0, length, spacing)
    return np.column_stack([x, 0 * x])


def missed(reference, points):
    """Largest distance of a point from a reference [m]."""
    time = np.linspace(0, reference.duration, round(reference.duration / 0.002))
    distance, _ = cKDTree(reference.pose(time)[:, :2]).query(points)
    return distance.max()


@pytest.mark.parametrize(
    ("spacing", "sigma"), [(0.02, 0.0), (0.02, 0.002), (0.005, 0.002), (0.002, 0.004), (0.1, 0.005)]
)
def test_a_noisy_straight_takes_as_long_as_a_straight(spacing, sigma):
    points = noisy(straight(4.0, spacing), sigma)
    reference = waypoints(points)
    length = 4.0 - spacing
    assert reference.duration == pytest.approx(length / LIMITS.speed + RAMPS, rel=0.01)
    assert missed(reference, points) <= TOLERANCE


def test_a_noisy_circle_keeps_its_radius():
    angle = np.arange(0, 2 * np.pi, 0.02)
    points = noisy(np.column_stack([np.cos(angle), np.sin(angle)]), 0.003)
    reference = waypoints(points)
    time = np.linspace(0, reference.duration, 5000)
    radius = np.hypot(*reference.pose(time)[:, :2].T)
    assert np.abs(radius - 1).max() < TOLERANCE
    assert reference.duration == pytest.approx(2 * np.pi / LIMITS.speed + RAMPS, rel=0.02)


def test_a_robot_that_stood_while_recording_doesnt_stop():
    way = straight(1.0, 0.02)
    points = np.concatenate([way, np.tile([1.0, 0.0], (200, 1)), way + np.array([1, 0])])
    reference = waypoints(noisy(points, 0.002))
    assert reference.duration == pytest.approx(2.0 / LIMITS.speed + RAMPS, rel=0.2)
    assert waypoints(points).duration == pytest.approx(1.98 / LIMITS.speed + RAMPS, rel=0.01)


def test_steps_of_a_grid_are_smoothed():
    steps = np.arange(41)
    points = 0.05 * np.column_stack([(steps + 1) // 2, steps // 2])
    exact = waypoints(points, tolerance=0.0)
    wide = waypoints(points, tolerance=0.02)  # more than the 17.7 mm from the steps to a line
    diagonal = float(np.hypot(*points[-1]))
    assert exact.duration > 250
    assert waypoints(points).duration < 45
    assert wide.duration == pytest.approx(diagonal / LIMITS.speed + RAMPS, rel=0.2)


def test_a_dense_corner_stays_a_bend_within_the_tolerance():
    """Three corners of 90 deg at 0.3 rad/s take 16 s longer than the way, however they are bent."""
    east = straight(1.0, 0.02)
    north = east[:, ::-1]
    starts = np.array([(0, 0), (1, 0), (1, 1), (2, 1)])
    legs = [east, north, east, north]
    points = np.concatenate([leg + start for leg, start in zip(legs, starts, strict=True)])
    for sigma in (0.0, 0.002):
        reference = waypoints(noisy(points, sigma))
        turns = 3 * np.pi / 2 / LIMITS.yaw_rate
        quickest = 4.0 / LIMITS.speed + RAMPS
        assert quickest < reference.duration < quickest + turns
        assert missed(reference, noisy(points, sigma)) <= TOLERANCE


def test_points_that_are_far_apart_or_smooth_are_met():
    corner = np.array([(0, 0), (1, 0), (1, 1), (2, 1)], float)
    angle = np.arange(0, np.pi, 0.05)
    arc = 0.4 * np.column_stack([np.sin(angle), 1 - np.cos(angle)])  # slower, but as meant
    for points in (corner, arc, noisy(straight(1.0, 0.02), 0.002)[::13]):
        assert missed(waypoints(points), points) < MET


def test_a_point_beside_an_end_counts_beyond_the_tolerance():
    aside = [(1.03, 0.05), (1.06, 0.0)]
    points = np.concatenate([straight(1.0, 0.01), aside])
    for way in (points, points[::-1]):
        assert missed(waypoints(way), way) <= TOLERANCE + MET


def test_tolerance_0_meets_all_points():
    points = noisy(straight(1.0, 0.04), 0.002)
    exact = waypoints(points, tolerance=0.0)
    assert missed(exact, points) < MET
    assert exact.duration > 1.5 * waypoints(points).duration
    with pytest.raises(InvalidValueError, match="tolerance"):
        waypoints(points, tolerance=-0.01)
    with pytest.raises(InvalidValueError, match=r"point 3 .* at least 0\.001 m from"):
        waypoints([(0, 0), (1, 0), (1.0005, 0), (2, 0)], tolerance=0.0)
    waypoints([(0, 0), (1, 0), (1.0005, 0), (2, 0)], tolerance=0.001)


def test_noise_of_headed_points_costs_no_time():
    """Neighbours are 1 cm apart; noise of 3 mm turns the ways between them by more than 45 deg."""
    angle = np.arange(0, 4, 0.01)
    points = np.column_stack([np.sin(angle), 1 - np.cos(angle)])
    exact = waypoints(points, yaw=angle)
    for seed in range(10):
        reference = waypoints(noisy(points, 0.003, seed), yaw=noisy(angle, 0.02, seed + 100))
        assert reference.duration == pytest.approx(exact.duration, rel=0.02)


def test_noise_beyond_the_tolerance_is_refused_with_the_remedy():
    points = noisy(straight(2.0, 0.004), 0.003, 1)
    with pytest.raises(InvalidValueError, match=r"larger tolerance than 0\.002 m"):
        waypoints(points, tolerance=0.002)


def test_headings_at_the_ends_are_kept():
    points = noisy(straight(2.0, 0.02), 0.002)
    yaw = np.zeros(len(points))
    yaw[0] = 0.3
    yaw[-1] = -0.4
    reference = waypoints(points, yaw=yaw)
    ends = reference.pose([0.0, reference.duration])
    np.testing.assert_allclose(ends[:, 2], [0.3, -0.4], atol=1e-9)
    np.testing.assert_allclose(ends[:, :2], points[[0, -1]], atol=1e-9)
    assert missed(reference, points) <= TOLERANCE


@settings(max_examples=15, deadline=None)
@given(
    st.sampled_from([name for name in REFERENCES if name != "stop_and_go"]),
    st.floats(0.004, 0.1),
    st.sampled_from([0.0, 0.001, 0.003]),
    st.sampled_from([0.01, TOLERANCE, 0.05]),
    st.booleans(),
    st.integers(0, 2**16),
)
def test_no_point_is_missed_by_more_than_the_tolerance(
    name, spacing, sigma, tolerance, has_yaw, seed
):
    # with headings, points beyond the tolerance are reversals
    assume(not has_yaw or 5 * sigma < tolerance)
    recorded = REFERENCES[name]()
    pose = recorded.pose(np.arange(0.0, recorded.duration, spacing / LIMITS.speed))
    points = noisy(pose[:, :2], sigma, seed)
    yaw = noisy(pose[:, 2], 5 * sigma, seed + 1) if has_yaw else None
    reference = waypoints(points, yaw=yaw, tolerance=tolerance)
    assert missed(reference, points) <= tolerance + MET
    assert integral_miss(reference) < 1e-8
    # noise doesn't cost more than half the time of the path itself
    assert reference.duration < 1.5 * recorded.duration + RAMPS


def energy(parameter, points, ends):
    """The integral of the squared second derivative of a cubic spline.

    Between two points the second derivative is linear, from a to b over the length h: the integral
    of its square is h (|a|^2 + |b|^2 + Re(a b*)) / 3.
    """
    conditions = tuple((2, 0.0) if end is None else (1, end) for end in ends)
    spline = CubicSpline(parameter, points, bc_type=conditions)
    second = spline(parameter, 2)
    begin = second[:-1]
    end = second[1:]
    squares = np.abs(begin) ** 2 + np.abs(end) ** 2
    products = (begin * end.conj()).real
    pieces = np.diff(parameter) * (squares + products) / 3
    return float(pieces.sum())


@pytest.mark.parametrize("ends", [Ends(), Ends(1.0 + 0j, np.exp(0.5j))])
def test_the_curve_is_the_smoothest_one(ends):
    """A general solver finds none with much less energy within the tolerance."""
    points = noisy(straight(0.6, 0.05), 0.01) @ [1, 1j]
    tolerance = np.full(len(points), 0.008)
    parameter, reached = smoothed(points, tolerance, ends)
    assert (np.abs(reached - points) <= tolerance).all()
    np.testing.assert_allclose(reached[[0, -1]], points[[0, -1]], atol=1e-12)

    def curve(moved):
        real, imaginary = moved.reshape(2, -1)
        return np.concatenate([points[:1], real + 1j * imaginary, points[-1:]])

    def room(moved):
        moves = np.abs(curve(moved) - points) / tolerance
        return 1 - moves[1:-1] ** 2

    def energy_of(moved):
        return energy(parameter, curve(moved), ends)

    between = points[1:-1]
    start = np.concatenate([between.real, between.imag])
    constraints = {"type": "ineq", "fun": room}
    best = minimize(energy_of, start, constraints=constraints, options={"maxiter": 500})
    assert energy(parameter, reached, ends) < 1.06 * best.fun


@pytest.mark.parametrize("wavelength", [2.0, np.pi, 6.0])
def test_noise_is_averaged_over_half_a_metre_at_most(wavelength):
    """However wide the tolerance: the curve y through dense points p minimises the integral of
    y''^2 + (y - p)^2 / L^4, so that waves of the wave number k are 1 + (k L)^4 times as flat.
    """
    spacing = 0.02
    x = np.arange(0.0, 20.0, spacing)
    wave = 0.001 * np.sin(2 * np.pi / wavelength * x)
    points = x + 1j * wave
    _, reached = smoothed(points, np.full(len(points), 0.1), Ends())
    far_from_the_ends = slice(400, -400)
    flatter = 1 + (2 * np.pi / wavelength * 0.5) ** 4
    np.testing.assert_allclose(
        reached.imag[far_from_the_ends], wave[far_from_the_ends] / flatter, atol=1e-7
    )


def test_quicker_limits_count_more_points_as_dense():
    """Bends that slow a robot of 0.15 m/s hardly matter at 0.05 m/s."""
    points = noisy(straight(3.0, 0.2), 0.004)
    slow = waypoints(points, MotionLimits(speed=0.05))
    assert missed(slow, points) < MET
