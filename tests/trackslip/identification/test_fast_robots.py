"""Laws of a fast skid-steered robot: much slip, much scatter, turns to both sides, sprockets at rest."""

import warnings

import numpy as np
import pytest
from slip_data import GEOMETRY as SLOW
from slip_data import grid

from trackslip.errors import LogError
from trackslip.identification.samples import SlipSamples
from trackslip.identification.steady_comparison import BASELINES, compare_laws
from trackslip.identification.steady_fit import fit_law
from trackslip.kinematics import RobotGeometry, track_slip
from trackslip.laws.icr import ConstantIcr
from trackslip.laws.turn_loss import Centrifugal, TurnLoss, TurnLossSides

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


@pytest.fixture(scope="module")
def found():
    return compare_laws(driven(count=47), GEOMETRY)


def test_the_best_law_is_the_one_that_predicts_motion_best(found):
    assert found.best == "turn_loss"
    assert "left-out radii" in found.reason
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


def test_a_baseline_is_always_in_the_table(found):
    assert set(BASELINES) <= set(found.laws)
    one_radius = grid(ConstantIcr(0.045, 0.168), radii=(0.63,))
    vague = fit_law("exponential", one_radius, SLOW, vague=True)
    assert set(vague.values) == {"alpha_outer", "beta_outer", "alpha_inner", "beta_inner"}
    assert vague.notes[0].endswith("it takes runs of different radii")
    with pytest.raises(LogError, match="it takes runs of different radii"):
        fit_law("exponential", one_radius, SLOW)


def test_sprockets_at_rest_are_used():
    samples = driven(count=32, rest=8, scatter=0.01)
    assert np.isnan(samples.slip[:8, 0]).all()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = compare_laws(samples, GEOMETRY)
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
