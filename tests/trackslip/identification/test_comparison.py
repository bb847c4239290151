import numpy as np
import pytest
from slip_data import ERRORS, GEOMETRY, RADII, coverage, grid

from trackslip.identification.samples import SlipSamples
from trackslip.identification.steady_comparison import compare_laws
from trackslip.identification.steady_fit import fit_law
from trackslip.laws.constant import Constant, NoSlip
from trackslip.laws.exponential import PUBLISHED, ExponentialSpeed
from trackslip.laws.icr import ConstantIcr, IcrSides

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


@pytest.mark.parametrize(("name", "law"), LAWS)
def test_the_law_that_made_the_samples_is_the_best(name, law):
    found = compare_laws(grid(law), GEOMETRY)
    assert found.best == name
    assert found.ranking.index(name) < 3
    fit = found.laws[name]
    for key, value in fit.values.items():
        assert abs(value - getattr(law, key)) < 4 * fit.stderr[key]
        low, high = fit.interval95[key]
        assert low < value < high


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
    rest = fit_law("icr_radius", samples.take(~tight), GEOMETRY)
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
    for key, value in found.laws["icr_sides"].values.items():
        assert value == pytest.approx(getattr(sides, key), abs=4 * found.laws["icr_sides"].stderr[key])
    assert compare_laws(grid(ICR, radii=both), GEOMETRY).best == "icr_radius"
    assert "icr_sides" not in compare_laws(grid(ICR), GEOMETRY).laws


@pytest.mark.parametrize("known", [True, False])
def test_intervals_cover(known):
    values = {"offset": 0.045, "radius_error": 0.0067}
    shares = coverage("icr_radius", values, grid(ICR), GEOMETRY, 60, np.random.default_rng(0), known)
    assert np.abs(np.array([*shares.values()]) - 0.95).max() < 0.113  # four standard errors of each share


def test_intervals_widen_when_repeats_share_what_the_law_does_not_know():
    """Each command has an error of its own, shared by its repeats, of which some commands have many and some few."""
    radii, covered = (*RADII, *(-radius for radius in RADII)), []
    clean = grid(ICR, errors=None, radii=radii, speeds=(0.2,))
    rows = np.repeat(np.arange(10), np.where(np.arange(10) < 3, 12, 3))
    for seed in range(60):
        rng = np.random.default_rng(seed)
        errors = 0.01 * rng.standard_normal((10, 2))[rows] + 0.001 * rng.standard_normal((len(rows), 2))
        twist = clean.twist[rows] + 0.2 * errors
        samples = SlipSamples.of(clean.omega[rows], twist, GEOMETRY, [f"{k}" for k in range(len(rows))])
        low, high = fit_law("icr_radius", samples, GEOMETRY).interval95["offset"]
        covered.append(low < ICR.offset < high)
    assert np.mean(covered) > 0.85
