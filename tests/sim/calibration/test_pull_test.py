"""Pull tests: cohesion, angle of friction and shear modulus from simulated tables."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sim.calibration.candidate import Candidate
from sim.calibration.pull_test import STRENGTH, PullTest, fit_pulls, on_soil
from sim.ground.ground import NAMED_GROUNDS
from sim.robot.parameters import RobotParameters
from trackslip.errors import InvalidValueError

SAND = Candidate(RobotParameters(), NAMED_GROUNDS["dry_sand"])
TRUE = replace(SAND.ground.soil, cohesion=1500.0, friction_angle=0.55, shear=0.015)
WEIGHT = 25 * 9.81
ALL = ("cohesion", "friction_angle", "shear")
SLIPS = (0.02, 0.05, 0.1, 0.15, 0.2, 0.3)


def pulls(*weights, slips=SLIPS, soil=TRUE, base=SAND):
    """A pull test of the true soil, without noise, with all slips at each weight."""
    slip = np.tile(slips, len(weights))
    weight = np.repeat(weights, len(slips)).astype(float)
    test = PullTest(slip, np.zeros_like(slip), weight, 0.1)
    return replace(test, pull=test.predicted(on_soil(base, soil)))


def values_of(fit):
    return {name: estimate.value for name, estimate in fit.estimates.items()}


def test_two_weights_tell_all_three_parameters():
    fit = fit_pulls(pulls(WEIGHT, 2 * WEIGHT), SAND, ALL)
    expected = {name: getattr(TRUE, name) for name in ALL}
    assert values_of(fit) == pytest.approx(expected, rel=1e-4)
    assert not any(estimate.vague for estimate in fit.estimates.values())
    soil = fit.candidate.ground.soil
    assert soil.cohesion == pytest.approx(1500.0, rel=1e-4)
    assert "shear" not in soil.assumed
    assert soil.source == "Wong, Land Locomotion Laboratory, fitted to pulls"


@pytest.mark.parametrize("given", ["cohesion", "friction_angle"])
def test_one_weight_tells_one_of_both_if_the_other_is_given(given):
    base = on_soil(SAND, replace(SAND.ground.soil, **{given: getattr(TRUE, given)}))
    free = tuple(name for name in ALL if name != given)
    fit = fit_pulls(pulls(WEIGHT), base, free)
    assert values_of(fit) == pytest.approx({name: getattr(TRUE, name) for name in free}, rel=1e-3)


@pytest.mark.slow
def test_one_weight_tells_only_the_strength():
    """Cohesion and friction have no intervals, and that of their sum covers any shares of both."""
    pressure = WEIGHT / (2 * SAND.robot.contact_length * SAND.robot.track_width)
    strength = TRUE.cohesion + pressure * math.tan(TRUE.friction_angle)
    test = pulls(WEIGHT)
    for cohesion in (0.0, 500.0, 3000.0):
        angle = math.atan((2400.0 - cohesion / 2) / pressure)
        base = on_soil(SAND, replace(TRUE, cohesion=cohesion, friction_angle=angle))
        fit = fit_pulls(test, base, ALL)
        known = fit.estimates[STRENGTH]
        assert known.low < strength < known.high
        for name in ("cohesion", "friction_angle"):
            part = fit.estimates[name]
            assert math.isnan(part.low)
            assert part.vague.startswith("all rows have one weight, which tells only the strength")
        shear = fit.estimates["shear"]
        assert shear.low < TRUE.shear < shear.high
    of_true_shares = fit_pulls(test, on_soil(SAND, replace(TRUE, shear=0.03)), ALL)
    assert of_true_shares.estimates[STRENGTH].value == pytest.approx(strength, rel=1e-3)


def test_small_slips_tell_shear_modulus_and_strength_together():
    """There, the pull is the strength times i L / (2 K)."""
    base = on_soil(SAND, TRUE)
    noise = 0.002 * WEIGHT * np.random.default_rng(0).standard_normal(6)
    test = pulls(WEIGHT, slips=(0.002, 0.003, 0.004, 0.005, 0.006, 0.007))
    fit = fit_pulls(replace(test, pull=test.pull + noise), base, ("friction_angle", "shear"))
    assert fit.estimates["shear"].vague == "the pulls do not distinguish it from friction_angle"
    assert "shear" in fit.candidate.ground.soil.assumed


def test_too_few_rows_and_other_names_are_refused():
    test = pulls(WEIGHT, slips=(0.05, 0.1, 0.2))
    with pytest.raises(InvalidValueError, match="one to 2 parameters for 3 pulls"):
        fit_pulls(test, SAND, ALL)
    with pytest.raises(InvalidValueError, match="must be one of cohesion, friction_angle, shear"):
        fit_pulls(test, SAND, ("friction",))


class PullAtTheGround(PullTest):
    """The same in closed form, with a hitch at the ground, which tilts nothing."""

    def predicted(self, candidate):
        soil = candidate.ground.soil
        robot = candidate.robot
        length, width = robot.contact_length, robot.track_width
        area = 2 * length * width
        strength = area * soil.cohesion + self.weight * math.tan(soil.friction_angle)
        rut = soil.sinkage(self.weight / area, width, self.slip)
        resistance = 2 * width * soil.work(rut, width, self.slip)
        return strength * soil.mobilised(self.slip, length) - resistance


def test_without_tilt_pulls_have_a_closed_form():
    slip = np.tile(SLIPS, 2)
    weight = np.repeat([WEIGHT, 2 * WEIGHT], len(SLIPS))
    options = (slip, np.zeros_like(slip), weight, 0.0)
    expected = PullAtTheGround(*options).predicted(SAND)
    np.testing.assert_allclose(PullTest(*options).predicted(SAND), expected, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.003, 0.02])
def test_intervals_cover_the_truth_in_95_of_100_tables(noise):
    """Of 500 tables, with noise of a share of the weight; their share scatters by 1 %."""
    rng = np.random.default_rng(7)
    slip = np.tile(SLIPS, 3)
    weight = np.repeat([WEIGHT, 1.5 * WEIGHT, 2 * WEIGHT], len(SLIPS))
    exact = PullAtTheGround(slip, np.zeros_like(slip), weight, 0.0)
    pull = exact.predicted(on_soil(SAND, TRUE))
    tables = 500
    covered = dict.fromkeys(ALL, 0)
    told = dict.fromkeys(ALL, 0)
    for _ in range(tables):
        noisy = pull + noise * weight * rng.standard_normal(len(slip))
        fit = fit_pulls(PullAtTheGround(slip, noisy, weight, 0.0), SAND, ALL)
        for name, estimate in fit.estimates.items():
            if not estimate.vague:
                told[name] += 1
                covered[name] += estimate.low <= getattr(TRUE, name) <= estimate.high
    for name in ALL:
        print(f"noise {noise:g}, {name}: {covered[name]} of {told[name]} intervals")
        assert told[name] > 0.9 * tables
        assert covered[name] / told[name] == pytest.approx(0.95, abs=0.03)
