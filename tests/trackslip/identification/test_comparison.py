from dataclasses import dataclass, replace

import numpy as np
import pytest
from slip_data import ERRORS, GEOMETRY, RADII, coverage, grid

from trackslip.identification.comparison import compare_laws
from trackslip.identification.fitted import fit_law
from trackslip.identification.lack_of_fit import SIGNIFICANT, lack_of_fit
from trackslip.identification.outliers import split_outliers
from trackslip.identification.samples import SlipSamples
from trackslip.identification.steady_fit import fit
from trackslip.identification.weighting import WeightedRuns
from trackslip.slip.base import SlipLaw
from trackslip.slip.constant import Constant, NoSlip
from trackslip.slip.exponential import PUBLISHED, ExponentialSpeed
from trackslip.slip.families import FAMILIES
from trackslip.slip.icr import ConstantIcr, IcrSides

pytestmark = pytest.mark.usefixtures("few_resamples")
ICR = ConstantIcr(0.045, 0.168, 0.0067)
SPEED = ExponentialSpeed(0.07, -0.68, -0.15, -0.63, 0.1, -0.2)
LAWS = [
    ("none", NoSlip()),
    ("constant", Constant(0.02, -0.04)),
    ("exponential", PUBLISHED),
    ("exponential_speed", SPEED),
    ("icr", ConstantIcr(0.045, 0.168)),
    ("icr_radius", ICR),
]


@dataclass(frozen=True)
class ShearDisplacement(SlipLaw):
    """Slip that builds up with shear displacement, as of tracks on soil: of another shape than all the laws."""

    size: float = 0.12
    length: float = 0.9

    def __call__(self, kappa):
        bend = np.asarray(kappa, float)
        grown = self.size * (1 - np.exp(-((np.abs(bend) * self.length) ** 1.6))) * np.sign(bend)
        return np.stack([-1.6 * grown, grown], axis=-1)


@pytest.mark.parametrize(("name", "law"), LAWS)
def test_the_law_that_made_the_samples_is_the_best(name, law):
    found = compare_laws(grid(law), GEOMETRY)
    assert found.best == name
    assert not found.laws[name].lacks_fit
    assert found.ranking.index(name) < 3
    fit = found.laws[name]
    for key, value in fit.values.items():
        assert abs(value - getattr(law, key)) < 4 * fit.stderr[key]
        low, high = fit.interval95[key]
        assert low < value < high
    assert sum(found.weight.values()) == pytest.approx(1)


def test_laws_of_another_shape_lack_fit_and_the_best_says_so():
    found = compare_laws(grid(PUBLISHED), GEOMETRY)
    assert found.warnings == ()
    for name in ("icr", "icr_radius"):
        assert found.laws[name].lacks_fit
        assert found.laws[name].lack_of_fit.inflation > 1.5
    neither = compare_laws(grid(ShearDisplacement()), GEOMETRY)
    for name in ("exponential", "icr", "icr_radius"):
        assert neither.laws[name].lacks_fit
    assert any(line.startswith(f"law {neither.best}: it misses the samples by") for line in neither.warnings)


@pytest.mark.parametrize("told", [True, False])
def test_a_law_that_fits_is_doubted_no_oftener_than_by_chance(told):
    samples = [grid(ICR, told=told, seed=seed) for seed in range(200)]
    runs = WeightedRuns.of(samples[0], GEOMETRY).measured(np.array([one.twist for one in samples]))
    tests = lack_of_fit(fit(FAMILIES["icr_radius"], runs), told)
    assert np.mean([test.probability < SIGNIFICANT for test in tests]) < 0.04  # 0.01 but for chance


def test_without_repeats_the_errors_of_measurement_tell():
    rng = np.random.default_rng(0)
    radii, speeds = 0.5 * 1.15 ** np.arange(12), rng.uniform(0.05, 0.3, 12)
    scattered = [grid(ICR, radii=(r,), speeds=(v,), seed=k) for k, (r, v) in enumerate(zip(radii, speeds, strict=True))]
    found = compare_laws(SlipSamples.joined(scattered), GEOMETRY)
    assert found.laws["icr_radius"].lack_of_fit.test == "chi2"
    assert not found.laws["icr_radius"].lacks_fit
    assert found.laws["icr"].lacks_fit
    untold = compare_laws(replace(SlipSamples.joined(scattered), covariance=None), GEOMETRY)
    assert untold.laws["icr_radius"].lack_of_fit is None


def test_left_out_radii_and_speeds_are_predicted_as_well_as_the_law_is_right():
    samples = grid(ICR)
    found = compare_laws(samples, GEOMETRY).validation
    right, wrong = found["icr_radius"], found["exponential"]
    noise = np.abs(samples.slip - ICR(samples.curvature)).max()
    assert right.radius < noise
    assert right.yaw_rate < 3 * ERRORS[1, 1] ** 0.5
    assert wrong.radius > 10 * right.radius
    assert wrong.yaw_rate > 10 * right.yaw_rate
    # by hand: leave out the tightest turns
    tight = samples.radius < 0.9
    rest = fit_law("icr_radius", samples.take(~tight), GEOMETRY, bootstraps=0)
    predicted = rest.law.twist(samples.omega[tight], GEOMETRY)[:, 1]
    assert np.abs(predicted - samples.twist[tight, 1]).max() < 3e-4
    one_radius = compare_laws(grid(ICR, radii=RADII[:1]), GEOMETRY).validation["icr"]
    assert one_radius.radius is None
    assert one_radius.yaw_rate is None
    assert one_radius.speed is not None


def test_sides_that_differ_are_told_when_turns_go_both_ways():
    sides = IcrSides(0.040, 0.050, 0.005, 0.012, 0.168)
    both = (*RADII, *(-radius for radius in RADII))
    found = compare_laws(grid(sides, radii=both), GEOMETRY)
    assert found.best == "icr_sides"
    assert any("left and right turns differ" in warning for warning in found.warnings)
    for key, value in found.laws["icr_sides"].values.items():
        assert value == pytest.approx(getattr(sides, key), abs=4 * found.laws["icr_sides"].stderr[key])
    assert compare_laws(grid(ICR, radii=both), GEOMETRY).best == "icr_radius"
    assert "icr_sides" not in compare_laws(grid(ICR), GEOMETRY).laws


@pytest.mark.parametrize("told", [True, False])
def test_outliers_are_left_out_and_listed(told):
    samples = grid(ICR, errors=np.diag([1e-4, 2e-4]) ** 2, told=told)
    samples.twist[7] *= [1.05, 0.93]
    samples.twist[19] *= [0.97, 1.0]
    spoilt = SlipSamples.of(samples.omega, samples.twist, GEOMETRY, samples.run, samples.covariance)
    kept, outliers = split_outliers(spoilt, GEOMETRY)
    assert [outlier.run for outlier in outliers] == [samples.run[7], samples.run[19]]
    assert len(kept) == 23
    assert split_outliers(kept, GEOMETRY)[1] == []
    # laws that are wrong make no outliers
    assert split_outliers(grid(PUBLISHED), GEOMETRY)[1] == []
    assert split_outliers(grid(ShearDisplacement()), GEOMETRY)[1] == []


def test_three_samples_only():
    few = grid(ICR, radii=RADII[:3], speeds=(0.15,), told=False)
    found = compare_laws(few, GEOMETRY)
    assert found.laws["icr_radius"].values["offset"] == pytest.approx(0.045, abs=0.003)
    assert found.laws["icr_radius"].bootstrap95 == {}
    assert found.laws["icr_radius"].lack_of_fit is None
    low, high = found.laws["icr_radius"].interval95["offset"]
    assert low < 0.045 < high
    assert any(warning.startswith("law exponential_speed") for warning in found.warnings)


def test_one_speed_does_not_determine_a_term_of_speed():
    found = compare_laws(grid(PUBLISHED, speeds=(0.15,)), GEOMETRY)
    assert "exponential_speed" not in found.laws
    assert any("don't determine" in w for w in found.warnings if w.startswith("law exponential_speed"))


@pytest.mark.parametrize("known", [True, False])
def test_intervals_cover(known):
    values = {"offset": 0.045, "radius_error": 0.0067}
    shares = coverage("icr_radius", values, grid(ICR), GEOMETRY, 60, np.random.default_rng(0), known)
    assert np.abs(np.array([*shares.values()]) - 0.95).max() < 0.113  # four standard errors of each share


def test_intervals_of_noise_alone_cover_the_fit_to_the_truth():
    truth = grid(SPEED, errors=None)  # which no ICR fits
    by_noise, whole = [], []
    for seed in range(30):
        samples = grid(SPEED, seed=seed)
        found = fit_law("icr_radius", samples, GEOMETRY, bootstraps=0)
        goal = fit_law("icr_radius", replace(samples, twist=truth.twist), GEOMETRY, bootstraps=0)
        for name, aim in goal.values.items():
            by_noise.append(abs(found.values[name] - aim) <= 1.96 * found.noise_stderr[name])
            whole.append(found.interval95[name][0] <= aim <= found.interval95[name][1])
    assert abs(np.mean(by_noise) - 0.95) < 0.085
    assert all(whole)  # for they answer for the law's lack of fit as well
