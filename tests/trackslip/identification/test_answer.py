"""The multipliers of samples by hand, compared with plain least squares."""

import re

import numpy as np
import pytest
from scipy.optimize import least_squares

from trackslip.errors import LogError
from trackslip.identification.answer import answer_of
from trackslip.identification.comparison import FittedLaw
from trackslip.identification.identify import identify_samples
from trackslip.identification.result import Identification, identification_to_json
from trackslip.identification.samples import Sampling, SlipSamples
from trackslip.identification.steady import fit_law
from trackslip.kinematics import RobotGeometry
from trackslip.laws.icr import ConstantIcr

GAUGE = 0.30  # between the wheels [m]
RADIUS = 0.05  # of the wheels [m]
GEOMETRY = RobotGeometry(GAUGE / 2, RADIUS)
STRAIGHT = [(6.0, 6.0), (10.0, 10.0), (6.0, 6.0), (10.0, 10.0)]
SPOT = [(-5.0, 5.0), (5.0, -5.0), (-8.0, 8.0), (8.0, -8.0)]
ARCS = [(4.0, 8.0), (8.0, 4.0), (6.0, 9.0), (9.0, 6.0)]


def motion(omega, separation=1.26, left=0.98, right=0.98, aside=0.0):
    """Twists (n, 2) of a robot with these multipliers, seen by a sensor `aside` to the left [m]."""
    belts = RADIUS * np.array(omega) * [left, right]
    turn = (belts[:, 1] - belts[:, 0]) / (separation * GAUGE)
    return np.column_stack([belts.mean(axis=1) - aside * turn, turn])


def by_hand(omega, noise=0.005, seed=0, **robot):
    """Samples as by a tape measure and a stopwatch, with errors relative to the belts."""
    twist = motion(omega, **robot)
    speed = RADIUS * np.abs(omega).max(axis=1)
    size = noise * speed[:, None] * [1.0, 2 / GAUGE]
    twist += size * np.random.default_rng(seed).standard_normal(twist.shape)
    names = [f"row {k + 1}" for k in range(len(omega))]
    return SlipSamples.of(np.array(omega), twist, GEOMETRY, names)


def answered(samples) -> Identification:
    return identify_samples(Sampling(samples, (), ()), GEOMETRY)


def multipliers(found):
    return [
        found.answer[f"{name}_multiplier"]
        for name in ("wheel_separation", "left_wheel_radius", "right_wheel_radius")
    ]


@pytest.mark.parametrize("seed", range(4))
def test_straights_and_turns_in_place_by_hand(seed):
    samples = by_hand(STRAIGHT + SPOT, seed=seed)
    found = answered(samples)

    def missed(values):
        twist = motion(samples.omega, *values)
        return ((twist - samples.twist) * [1.0, GAUGE / 2]).ravel()

    plain = least_squares(missed, np.ones(3)).x
    values = [gain.value for gain in multipliers(found)]
    np.testing.assert_allclose(values, plain, rtol=0.01)
    assert found.best == "icr_radius"
    assert "the samples have 2 of the 4 different curvatures" in found.main.reason


def test_speeds_that_scatter_by_hand_are_no_other_curvatures():
    """A remote control's, by up to 5 % between the sides."""
    straight = [(6.0, 6.3), (10.0, 9.8), (6.0, 6.0), (10.0, 10.3)]
    spot = [(-5.0, 5.2), (5.2, -5.0), (-8.0, 7.8), (8.0, -8.3)]
    found = answered(by_hand(straight + spot))
    assert "the samples have 2 of the 4 different curvatures" in found.main.reason


def test_radii_that_differ_by_hand():
    found = answered(by_hand(STRAIGHT + SPOT, left=0.97, right=1.0))
    for gain, true in zip(multipliers(found), (1.26, 0.97, 1.0), strict=True):
        assert abs(gain.value - true) <= 1.5 * gain.error
        assert gain.error < 0.03
    assert found.best == found.expressible == "diff_drive"


@pytest.mark.parametrize("aside", [0.0, 0.015])
def test_a_sensor_beside_the_middle_is_no_difference_of_radii(aside):
    found = answered(by_hand(STRAIGHT + SPOT + ARCS, aside=aside, noise=0.002))
    values = [gain.value for gain in multipliers(found)]
    np.testing.assert_allclose(values, [1.26, 0.98, 0.98], atol=0.01)


@pytest.mark.parametrize(
    ("omega", "unknown", "remedy"),
    [
        (STRAIGHT, {"wheel_separation_multiplier", "offset"}, "drive turns to both sides"),
        (
            SPOT,
            {"left_wheel_radius_multiplier", "right_wheel_radius_multiplier", "radius_error"},
            "drive straight",
        ),
    ],
)
def test_what_samples_do_not_tell_is_named_alone(omega, unknown, remedy):
    found = answered(by_hand(omega))
    assert found.undetermined.keys() == unknown
    assert all(remedy in line for line in found.undetermined.values())
    for name, gain in found.answer.items():
        assert np.isnan(gain.value) == (name in unknown)
        assert (gain.to_json()["value"] is None) == (name in unknown)
    assert not re.search(r"nan|no interval", repr(found))
    assert identification_to_json(found)["undetermined"] == found.undetermined


def test_straights_tell_a_difference_of_radii():
    found = answered(by_hand(STRAIGHT, left=0.97, right=1.0))
    _, left, right = multipliers(found)
    assert (left.value, right.value) == pytest.approx((0.97, 1.0), abs=0.01)


def test_turns_in_place_tell_no_difference_of_radii():
    with pytest.raises(LogError, match="don't determine"):
        fit_law("diff_drive", by_hand(SPOT), GEOMETRY)


def test_one_arc_tells_a_separation_and_a_radius():
    found = answered(by_hand(ARCS[:1] * 4))
    values = [gain.value for gain in multipliers(found)]
    np.testing.assert_allclose(values, [1.26, 0.98, 0.98], atol=0.05)


@pytest.mark.parametrize("seed", range(3))
def test_turns_in_place_leave_separation_as_open_as_radius(seed):
    found = answered(by_hand(SPOT, seed=seed))
    separation, left, _ = multipliers(found)
    assert separation.low < 1.26 < separation.high
    assert 0.03 < separation.error < 0.08
    assert np.isnan(left.value)
    assert "drive straight" in found.undetermined["left_wheel_radius_multiplier"]


def test_speeds_by_hand_that_scatter_are_no_other_curvatures():
    noise = np.random.default_rng(0).normal(0.0, 0.05, (8, 2))
    scattered = np.array(STRAIGHT + SPOT) + noise
    found = answered(by_hand(scattered))
    assert "the samples have 2 of the 4 different curvatures" in found.main.reason


def test_multipliers_end_where_the_limits_of_a_law_do():
    """One end of an interval may be cut off: the multiplier is 1 + D / b there, too."""
    interval = (-0.003, 0.084)
    fit = FittedLaw(
        name="icr_radius",
        law=ConstantIcr(0.004, GAUGE / 2, 0.0),
        values={"offset": 0.004, "radius_error": 0.0},
        stderr={"offset": 0.04, "radius_error": 0.01},
        interval95={"offset": interval, "radius_error": (-0.02, 0.02)},
        correlation=np.eye(2),
    )
    gain = answer_of(fit, GAUGE / 2)["wheel_separation_multiplier"]
    expected = 1 + np.array([0.004, *interval]) / (GAUGE / 2)
    assert tuple(gain) == pytest.approx(tuple(expected))
