"""Laws of a fast skid-steered robot: much slip, much scatter, turns to both sides, sprockets at rest."""

import warnings

import numpy as np
import pytest
from scipy.optimize import least_squares
from slip_data import GEOMETRY as SLOW
from slip_data import grid

from trackslip.errors import LogError
from trackslip.identification.comparison import BASELINES, compare_laws
from trackslip.identification.fitted import fit_law
from trackslip.identification.lack_of_fit import by_command, folds, group_labels
from trackslip.identification.outliers import split_outliers
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import RobotGeometry, track_slip
from trackslip.metrics import rms
from trackslip.slip.families import FAMILIES
from trackslip.slip.icr import ConstantIcr
from trackslip.slip.turn_loss import Centrifugal, TurnLoss, TurnLossSides

pytestmark = pytest.mark.usefixtures("few_resamples")
GEOMETRY = RobotGeometry(0.28, 0.16)
LAW = TurnLoss(0.30, 0.28, 0.02, 0.35)
_TOP_SPEED = 2.0  # of a belt [m/s]


def driven(law=LAW, *, count=60, scatter=0.03, seed=0, rest=0, errors=0.01):
    """Samples of commands at random, forwards, backwards and in place, with heavy-tailed scatter."""
    rng = np.random.default_rng(seed)
    mean = rng.uniform(0.1, 1, count) * np.where(rng.random(count) < 0.15, -1, 1)
    ratio = rng.uniform(-1.2, 1.2, count)
    omega = np.column_stack([mean * (1 - ratio), mean * (1 + ratio)])
    omega *= _TOP_SPEED / GEOMETRY.sprocket_radius / np.maximum(1, np.abs(omega).max(axis=1, keepdims=True))
    omega[:rest, 0] = 0.0
    size = GEOMETRY.sprocket_radius * np.abs(omega).max(axis=1, keepdims=True)
    twist = law.twist(omega, GEOMETRY) + errors * rng.standard_normal((count, 2))
    twist += scatter * size * np.clip(rng.standard_t(5, (count, 2)), -4, 4) * [1, 1 / (2 * GEOMETRY.half_gauge)]
    covariance = np.tile(errors**2 * np.eye(2), (count, 1, 1)) if errors else None
    names = tuple(f"row {k + 1}" for k in range(count))
    return SlipSamples(omega, twist, track_slip(omega, twist, GEOMETRY), names, covariance)


def plain(name, samples):
    """The law of a plain least-squares fit of speeds and yaw rates, by another optimiser."""
    family = FAMILIES[name]

    def residual(values):
        missed = family.law(values, GEOMETRY).twist(samples.omega, GEOMETRY) - samples.twist
        return (missed * [1, GEOMETRY.half_gauge]).ravel()

    start = family.starts(GEOMETRY.half_gauge)[0]
    return family.law(least_squares(residual, start, x_scale="jac").x, GEOMETRY)


@pytest.mark.parametrize("name", ["icr_radius", "turn_loss"])
def test_yaw_rates_are_predicted_as_well_as_by_plain_least_squares(name):
    """Even where the law is wrong, slow sprockets don't spoil it."""
    ours, theirs = [], []
    for seed in range(40):
        samples, unseen = driven(seed=seed), driven(seed=1000 + seed, scatter=0.0, errors=0.0)
        for errors, law in ((ours, fit_law(name, samples, GEOMETRY, bootstraps=0).law), (theirs, plain(name, samples))):
            errors.append(rms(law.twist(unseen.omega, GEOMETRY)[:, 1] - unseen.twist[:, 1]))
    assert rms(np.array(ours)) < 1.05 * rms(np.array(theirs))


@pytest.fixture(scope="module")
def found():
    return compare_laws(driven(count=47), GEOMETRY)


def test_the_best_law_is_the_one_that_predicts_motion_best(found):
    assert found.best == "turn_loss"
    assert found.criterion == "left-out radii"
    best, law = found.validation["turn_loss"], found.laws["turn_loss"]
    for name, one in found.validation.items():
        if name != "turn_loss":
            assert one.linear_speed > best.linear_speed
            assert one.run > best.run
    assert law.values["offset"] == pytest.approx(0.30, abs=4 * law.stderr["offset"])


@pytest.mark.parametrize(
    ("name", "law"),
    [
        ("turn_loss_sides", TurnLossSides(0.30, 0.05, -0.02, 0.28, 0.35)),
        ("centrifugal", Centrifugal(0.30, 0.28, 0.02, 0.35, 0.3)),
    ],
)
def test_unequal_sides_and_skidding_are_found_within_errors(name, law):
    found = compare_laws(driven(law, count=80, scatter=0.01), GEOMETRY)
    assert found.best == name
    fit = found.laws[name]
    for key, value in fit.values.items():
        assert value == pytest.approx(getattr(law, key), abs=4 * fit.stderr[key])
        assert fit.stderr[key] < 0.1


def test_skidding_is_looked_for_only_where_turns_are_fast(found):
    slow = compare_laws(grid(ConstantIcr(0.045, 0.168)), SLOW)
    named = [
        "centrifugal" in (*one.laws, *(line.split()[1].rstrip(":") for line in one.warnings)) for one in (found, slow)
    ]
    assert named == [True, False]


def test_a_baseline_is_always_in_the_table(found):
    assert set(BASELINES) <= set(found.laws)
    one_radius = grid(ConstantIcr(0.045, 0.168), radii=(0.63,))
    vague = fit_law("exponential", one_radius, SLOW, vague=True)
    assert set(vague.values) == {"alpha_outer", "beta_outer", "alpha_inner", "beta_inner"}
    assert vague.notes[0].endswith("it takes runs of different radii")
    with pytest.raises(LogError, match="it takes runs of different radii"):
        fit_law("exponential", one_radius, SLOW)


def test_reasons_are_true(found):
    """Runs of many radii lack no radii."""
    for warning in found.warnings:
        assert "different radii" not in warning


def test_sprockets_at_rest_are_used():
    samples = driven(count=32, rest=8, scatter=0.01)
    assert np.isnan(samples.slip[:8, 0]).all()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        kept, outliers = split_outliers(samples, GEOMETRY)
        found = compare_laws(kept, GEOMETRY)
    assert outliers == []
    assert found.best == "turn_loss"
    for law in found.laws.values():
        assert np.isfinite([law.rms, law.scatter, *law.values.values()]).all()
    only = samples.take(np.arange(8))
    assert fit_law("icr", only, GEOMETRY).values["offset"] == pytest.approx(0.30, abs=0.02)


@pytest.mark.parametrize("count", [1, 7])
@pytest.mark.parametrize("told", [True, False])
def test_exact_samples_are_no_trouble(count, told):
    twist = np.column_stack([np.full(7, 0.2), [0.4, -0.4, 0.1, 0.2, -0.1, 0.3, 0.0]])[:count]
    omega = ConstantIcr(0.3, 0.28).sprocket_speeds(twist, GEOMETRY)
    exact = np.zeros((count, 2, 2)) if told else None
    samples = SlipSamples(omega, twist, track_slip(omega, twist, GEOMETRY), tuple("abcdefg"[:count]), exact)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = compare_laws(samples, GEOMETRY)
    assert found.laws["icr"].values["offset"] == pytest.approx(0.3, abs=1e-6)


def test_intervals_widen_when_repeats_share_what_the_law_does_not_know():
    """Each command has an error of its own, shared by its repeats, of which some commands have many and some few."""
    covered = []
    for seed in range(120):
        rng = np.random.default_rng(seed)
        design = driven(ConstantIcr(0.3, 0.28), count=16, scatter=0.0, seed=1000 + seed, errors=0.0)
        rows = np.repeat(np.arange(16), np.where(np.arange(16) < 4, 12, 3))
        size = GEOMETRY.sprocket_radius * np.abs(design.omega).max(axis=1, keepdims=True) * [1, 1 / GEOMETRY.half_gauge]
        shared = 0.03 * size * rng.standard_normal((16, 2))
        twist = (design.twist + shared)[rows] + 0.005 * size[rows] * rng.standard_normal((len(rows), 2))
        omega = design.omega[rows]
        samples = SlipSamples(omega, twist, track_slip(omega, twist, GEOMETRY), tuple(map(str, range(len(rows)))))
        low, high = fit_law("icr", samples, GEOMETRY, bootstraps=0).interval95["offset"]
        covered.append(low < 0.3 < high)
    assert np.mean(covered) > 0.9


def test_groups_of_commands():
    np.testing.assert_array_equal(group_labels(np.array([1.0, 0.5, 1.01, 0.505, -1.0]), 0.1), [2, 1, 2, 1, 0])
    evenly = group_labels(np.linspace(0.2, 2.0, 2000), 0.1)  # no gaps: cut into pieces of about 2 %
    assert 90 < evenly.max() < 150
    many = driven(count=300)
    labels = folds(by_command(many.omega, GEOMETRY))
    assert labels.max() + 1 == 10
    assert np.bincount(labels).min() > 15
