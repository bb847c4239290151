import numpy as np
import pytest
from quadrature import integral_miss, times
from scipy.special import fresnel

from trackslip.errors import InvalidValueError
from trackslip.trajectory.named import (
    REFERENCES,
    ClothoidPath,
    PathPiece,
    figure_eight,
    rounded_square,
    slalom,
    spiral,
)
from trackslip.trajectory.path import (
    KNOT_SPACING,
    LIMITS,
    MAX_LENGTH,
    MotionLimits,
    ParametricPath,
    ProfiledReference,
)
from trackslip.trajectory.segmented import Segment, SegmentedReference, circle, paper_reference
from trackslip.trajectory.waypoints import waypoints

ORIGIN = (0.0, 0.0, 0.0)


def driven(reference, n=2001):
    """Poses (n, 3) and twists (n, 2) of a reference."""
    time = np.linspace(0, reference.duration, n)
    return reference.pose(time), reference.twist(time)


def test_figure_eight_is_bernoullis_lemniscate():
    a = 1.5
    pose, twist = driven(figure_eight((0, 0, -np.pi / 4)))
    x, y, phi = pose.T
    np.testing.assert_allclose((x**2 + y**2) ** 2, a**2 * (x**2 - y**2), atol=1e-11)
    np.testing.assert_allclose([x[-1], y[-1], phi[-1]], [0, 0, -np.pi / 4], atol=1e-11)
    assert np.ptp(x) == pytest.approx(2 * a, abs=1e-4)
    moving = twist[:, 0] > 1e-3
    v, w = twist[moving].T
    distance = np.hypot(x, y)[moving]
    np.testing.assert_allclose(np.abs(w / v), 3 * distance / a**2, atol=1e-9)
    # left round one lobe, right round the other
    assert x[np.argmax(phi)] == pytest.approx(0, abs=2e-2)


def parabola(u, order):
    """u + i u^2 / 2 and its derivatives."""
    return [u + 0.5j * u**2, 1 + 1j * u, 1j + 0 * u][order]


def test_a_parabola_is_followed_by_its_length():
    """From 0 to u, it is (u sqrt(1 + u^2) + asinh(u)) / 2 long."""
    path = ParametricPath(parabola, [-1.0, 2.0])
    u = np.linspace(-1.0, 2.0, 997)
    from_middle = (u * np.sqrt(1 + u**2) + np.arcsinh(u)) / 2
    s = from_middle - from_middle[0]
    pose = path.pose(s)
    np.testing.assert_allclose(path.parameter(s), u, atol=2e-12)
    np.testing.assert_allclose(pose[:, 0], u, atol=2e-12)
    np.testing.assert_allclose(pose[:, 1], u**2 / 2, atol=4e-12)
    np.testing.assert_allclose(pose[:, 2], np.arctan(u), atol=2e-12)
    np.testing.assert_allclose(path.curvature(s), (1 + u**2) ** -1.5, atol=1e-11)
    assert path.knots[-1] == pytest.approx(s[-1], abs=1e-12)
    assert np.diff(path.knots).max() <= KNOT_SPACING
    assert len(ParametricPath(parabola, [0.0, 1e-4]).knots) == 3

    start = np.array([3.0, -2.0, 0.5])
    moved = ParametricPath(parabola, [-1.0, 2.0], start).pose(s)
    np.testing.assert_allclose(moved[0], start)
    turn = start[2] - pose[0, 2]
    along = (pose[:, :2] - pose[0, :2]) @ [1, 1j] * np.exp(1j * turn)
    np.testing.assert_allclose((moved[:, :2] - start[:2]) @ [1, 1j], along, atol=1e-11)
    np.testing.assert_allclose(moved[:, 2] - pose[:, 2], turn)


def test_a_cusp_is_no_path_but_a_bend_of_a_millimetre_is():
    def bent(width):
        """A parabola whose smallest radius is about width^2 / 2; a cusp for a width of 0."""

        def curve(u, order):
            return [u**2 + 1j * width * u, 2 * u + 1j * width, 2 + 0j * u][order]

        return curve

    ParametricPath(bent(0.045), [-1.0, 1.0])
    with pytest.raises(InvalidValueError, match=r"turns back sharply at \(0\.000, 0\.000\)"):
        ParametricPath(bent(0.0), [-1.0, 1.0])
    with pytest.raises(InvalidValueError, match="length of the path"):
        ParametricPath(lambda u, order: [u + 0j, 1 + 0j * u, 0j * u][order], [0.0, MAX_LENGTH + 1])


def test_slalom_is_a_sine():
    pose, _ = driven(slalom(ORIGIN))
    x, y, phi = pose.T
    np.testing.assert_allclose(y, 0.25 * (1 - np.cos(np.pi * x)), atol=1e-11)
    np.testing.assert_allclose(np.tan(phi), 0.25 * np.pi * np.sin(np.pi * x), atol=1e-10)
    assert x[-1] == pytest.approx(4.0, abs=1e-11)


def test_spiral_is_archimedes():
    """The distance to the centre falls evenly with the angle about it."""
    outer = 1.2
    inner = 0.45
    turns = 1.5
    shrinkage = (outer - inner) / (2 * np.pi * turns)
    heading = np.pi / 2 + np.arctan(shrinkage / outer)
    pose, _ = driven(spiral((outer, 0, heading)))
    x, y, phi = pose.T
    angle = np.unwrap(np.arctan2(y, x))
    np.testing.assert_allclose(np.hypot(x, y), outer - shrinkage * angle, atol=1e-11)
    assert angle[-1] == pytest.approx(2 * np.pi * turns, abs=1e-10)
    assert np.all(np.diff(phi) >= 0)


@pytest.mark.parametrize("sharpness", [1.5, -0.4])
def test_clothoid_is_fresnels(sharpness):
    """x = scale C(s / scale), y = +/- scale S(s / scale), with scale = sqrt(pi / |sharpness|)."""
    length = 2.3
    path = ClothoidPath(ORIGIN, [PathPiece(length, 0.0, length * sharpness)])
    s = np.linspace(0, length, 301)
    scale = np.sqrt(np.pi / abs(sharpness))
    sine, cosine = fresnel(s / scale)
    x = scale * cosine
    y = np.sign(sharpness) * scale * sine
    heading = sharpness * s**2 / 2
    np.testing.assert_allclose(path.pose(s), np.column_stack([x, y, heading]), atol=1e-13)
    np.testing.assert_allclose(path.curvature(s), sharpness * s, atol=1e-13)


SPEED = 0.2
ACCELERATION = 0.05


@pytest.mark.parametrize(
    ("length", "duration"),
    [
        pytest.param(3.0, 3.0 / SPEED + SPEED / ACCELERATION, id="trapezium"),
        pytest.param(0.01, 2 * np.sqrt(0.01 / ACCELERATION), id="short triangle"),
        pytest.param(0.3, 2 * np.sqrt(0.3 / ACCELERATION), id="triangle"),
    ],
)
def test_a_straight_takes_a_trapezium_or_triangle_of_speed(length, duration):
    path = ClothoidPath(ORIGIN, [PathPiece(length)])
    reference = ProfiledReference(path, MotionLimits(speed=SPEED, acceleration=ACCELERATION))
    assert reference.duration == pytest.approx(duration, rel=1e-3)
    early = duration / 9
    np.testing.assert_allclose(reference.twist(early), [ACCELERATION * early, 0.0], rtol=1e-6)


def test_it_brakes_before_a_corner_and_speeds_up_after_it():
    limits = LIMITS
    reference = rounded_square(ORIGIN)
    v, w = reference.twist(reference.knots).T
    in_corner = np.abs(w) > 0
    np.testing.assert_allclose(v[in_corner], 0.12, atol=1e-9)
    assert v[~in_corner].max() == pytest.approx(0.15)
    # nowhere could it be quicker: it always accelerates, brakes, or is at a limit
    acceleration = np.abs(np.diff(v) / np.diff(reference.knots))
    curvature = np.where(in_corner, 2.5, 0.0)
    at_limit = np.isclose(v, limits.speed_at(curvature))
    changes = np.isclose(acceleration, limits.acceleration, rtol=1e-6)
    idle = ~changes & ~(at_limit[1:] & at_limit[:-1])
    assert idle.sum() <= 3 * 5 + 4  # cells in which it changes from one to the other


def test_one_of_three_limits_is_reached_in_every_bend():
    """The track on the outside runs at v + b |w|."""
    bend = np.linspace(-4.0, 4.0, 81)
    for half_gauge in (0.0, 0.3, 2.0):
        limits = MotionLimits(0.5, yaw_rate=0.8, track_speed=0.6, half_gauge=half_gauge)
        v = limits.speed_at(bend)
        w = np.abs(v * bend)
        shares = np.array([v / 0.5, w / 0.8, (v + half_gauge * w) / 0.6])
        np.testing.assert_allclose(shares.max(axis=0), 1.0)


def test_scaled_limits_ask_for_the_same_shares_in_bends():
    bend = np.linspace(0.0, 4.0, 41)
    faster = HASTY.scaled(1.5, top_speed=10.0)
    np.testing.assert_allclose(faster.speed_at(bend), 3 * HASTY.speed_at(bend))
    assert faster.speed / faster.acceleration == pytest.approx(HASTY.speed / HASTY.acceleration)
    assert HASTY.scaled(1.5, top_speed=1.7).track_speed == 1.7


START = (0.7, -0.4, 2.5)
POINTS = [(0, 0), (1, 0.2), (1.2, 1), (0.1, 1.5), (-1, 0.3)]
HASTY = MotionLimits(speed=0.5, acceleration=0.4, yaw_rate=0.8, track_speed=0.6, half_gauge=0.3)
MADE = {
    "left circle": circle(1.25, 0.15, 40.0, (1.0, 2.0, 0.5)),
    "right circle": circle(-0.8, 0.15, 40.0),
    "reverse": SegmentedReference(
        (0, 0, 0), [Segment(3.0, 0.0, -0.2, 0.5), Segment(3.0, -0.2, 0.0, -0.5)]
    ),
    "hasty clothoid": ProfiledReference(
        ClothoidPath(START, [PathPiece(0.8, 3.0, -3.0), PathPiece(0.9)]), HASTY
    ),
    "waypoints": waypoints(POINTS),
    "hasty waypoints": waypoints(POINTS, HASTY),
}
EVERY = {name: make() for name, make in REFERENCES.items()} | MADE
LIMITED = (
    {name: LIMITS for name in REFERENCES if name != "circle"}
    | {"waypoints": LIMITS}
    | {name: HASTY for name in MADE if name.startswith("hasty")}
)


def test_the_papers_path_is_the_one_in_words():
    reference = paper_reference()
    assert reference.duration == pytest.approx(45.8, abs=0.02)
    np.testing.assert_allclose(reference.pose(0.0), [0, 0, np.pi / 2])
    np.testing.assert_allclose(reference.pose(3.0), [0, 0.015 * 9, np.pi / 2], atol=1e-12)
    np.testing.assert_allclose(reference.twist(8.0), [0.15, 0.0])
    np.testing.assert_allclose(reference.twist(20.0), [0.15, 0.12])
    # centre of the arc, radius 1.25, from any pose on it
    x, y, phi = reference.pose(np.linspace(12.1, 33.7, 50)).T
    np.testing.assert_allclose(x - 1.25 * np.sin(phi), -1.25, atol=1e-12)
    np.testing.assert_allclose(y + 1.25 * np.cos(phi), 1.425, atol=1e-12)
    assert reference.pose(34.0)[2] == pytest.approx(4 * np.pi / 3)


@pytest.mark.parametrize("name", EVERY)
def test_pose_is_the_integral_of_the_twist(name):
    assert integral_miss(EVERY[name]) < 1e-10


@pytest.mark.parametrize("name", EVERY)
def test_it_stands_before_and_after(name):
    reference = EVERY[name]
    end = reference.duration
    np.testing.assert_array_equal(reference.twist([-3.0, -1e-9, end, end + 1e-9, end + 100]), 0)
    np.testing.assert_array_equal(reference.pose(-3.0), reference.pose(0.0))
    np.testing.assert_array_equal(reference.pose(end + 100), reference.pose(end))


@pytest.mark.parametrize("name", LIMITED)
def test_it_starts_and_ends_at_rest_and_within_its_limits(name):
    reference = EVERY[name]
    limits = LIMITED[name]
    knots = reference.knots
    time = times(reference)
    middles = (time[1:] + time[:-1]) / 2
    before_knots = np.nextafter(knots, 0)
    v, w = reference.twist(np.sort(np.concatenate([time, middles, before_knots]))).T
    slack = 1 + 1e-6
    assert np.abs(v).max() <= limits.speed * slack
    assert np.abs(w).max() <= limits.yaw_rate * slack
    faster_track = np.abs(v) + limits.half_gauge * np.abs(w)
    assert faster_track.max() <= limits.track_speed * slack
    # speeds at a quarter and three quarters of each cell
    cell = np.diff(knots)
    first = reference.twist(knots[:-1] + 0.25 * cell)[:, 0]
    second = reference.twist(knots[:-1] + 0.75 * cell)[:, 0]
    acceleration = (second - first) / (cell / 2)
    assert np.abs(acceleration).max() <= limits.acceleration * (1 + 1e-5)
    np.testing.assert_allclose(reference.twist([1e-9, reference.duration - 1e-9]), 0, atol=1e-8)
