"""Samples that are refused, and ones that look odd but are what robots do."""

import numpy as np
import pytest

from trackslip.errors import LogError
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import RobotGeometry, body_twist

GEOMETRY = RobotGeometry(0.168, 0.06)
ROBOTS = (GEOMETRY, RobotGeometry(0.3, 0.165), RobotGeometry(1.1, 0.4))


def sample(omega, twist, geometry=GEOMETRY, yaw_stderr=None):
    covariance = None if yaw_stderr is None else np.diag([1e-8, yaw_stderr**2])[None]
    return SlipSamples.of(np.array([omega]), np.array([twist]), geometry, ["odd"], covariance)


@pytest.mark.parametrize("geometry", ROBOTS)
@pytest.mark.parametrize("kept", [1.3, 1.0, 0.7, 0.4, 0.2])
def test_a_robot_that_loses_most_of_its_yaw_rate_is_plausible(geometry, kept):
    rng = np.random.default_rng(0)
    for _ in range(300):
        omega = rng.uniform(-10, 10, 2)
        ideal = body_twist(omega, 0.0, geometry)
        twist = ideal * [rng.uniform(0.8, 1.05), kept]
        found = sample(omega, twist, geometry)
        assert len(found) == 1


def test_an_inner_track_that_is_dragged_along():
    """A fast skid-steered robot: its inner wheels move five times as fast as they turn."""
    omega = np.array([1.0, 9.0])
    v, w = body_twist(omega, 0.0, GEOMETRY)
    assert sample(omega, [v, 0.4 * w]).slip[0, 0] < -2


def test_a_yaw_rate_within_its_error_says_nothing_of_swapped_tracks():
    omega, twist = [2.0, 3.0], [0.15, -0.05]
    with pytest.raises(LogError, match="left and right, and the signs"):
        sample(omega, twist, yaw_stderr=0.001)
    assert len(sample(omega, twist, yaw_stderr=0.05)) == 1


@pytest.mark.parametrize("radius", [0.5, 1.0, 2.0])
def test_swapped_tracks_are_noticed_in_turns(radius):
    twist = np.array([0.15, 0.15 / radius])
    left, right = (twist[0] + np.array([-1, 1]) * 0.21 * twist[1]) / 0.06
    with pytest.raises(LogError, match=r"moves at 0.15 m/s and \+.* its sprockets say 0.15 m/s and -"):
        sample([right, left], twist)


@pytest.mark.parametrize("signs", [(-1, 1), (1, -1), (-1, -1)])
def test_encoders_that_count_backwards_are_noticed(signs):
    twist = np.array([0.2, 0.1])
    omega = (twist[0] + np.array([-1, 1]) * 0.21 * twist[1]) / 0.06
    with pytest.raises(LogError, match="left and right, and the signs"):
        sample(omega * signs, twist)


@pytest.mark.parametrize("radius", [0.6, 2.0, 1e6])
@pytest.mark.parametrize(
    ("of_omega", "of_v", "of_w"),
    [(180 / np.pi, 1, 1), (30 / np.pi, 1, 1), (1, 1000, 1), (1, 100, 1), (1, 1, 180 / np.pi), (30, 1, 1)],
)
def test_wrong_units_are_noticed(radius, of_omega, of_v, of_w):
    """deg/s, rpm, millimetres, centimetres, degrees, a gear."""
    if radius > 1e3 and of_w != 1:
        return  # nothing turns
    twist = np.array([0.2, 0.2 / radius])
    omega = (twist[0] + np.array([-1, 1]) * 0.21 * twist[1]) / 0.06
    with pytest.raises(LogError, match=r"check the units .* the gear, sprocket_radius = 0\.06 m"):
        sample(omega * of_omega, twist * [of_v, of_w])


def test_runs_of_a_command_and_of_a_speed():
    """Repeats differ by less than a degree or by 1 % of the fastest."""
    omega = np.array([[1.0, 2.0], [2.0, 1.0], [1.0, 2.01], [2.0, 4.0], [3.0, 4.0]])
    found = SlipSamples.of(omega, body_twist(omega, 0.0, GEOMETRY), GEOMETRY, list("abcde"))
    np.testing.assert_array_equal(found.by_command(GEOMETRY), [2, 0, 2, 2, 1])
    np.testing.assert_array_equal(found.by_speed(), [0, 0, 0, 1, 1])
