import numpy as np
import pytest

from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.samples import SlipSamples, true_samples, usable_samples
from trackslip.identification.steady_comparison import compare_laws
from trackslip.identification.steady_fit import fit_law
from trackslip.kinematics import RobotGeometry, advance, body_twist
from trackslip.laws.exponential import PUBLISHED
from trackslip.laws.icr import ConstantIcr
from trackslip.logs.runlog import RunLog

GEOMETRY = RobotGeometry(0.168, 0.06)
KAPPA = np.array([1.6, 0.8, 0.5, 0.4, 0.3, -1.0, -0.35])


def samples_of(law, kappa=KAPPA, noise=0.0, seed=0):
    twist = np.column_stack([np.full(kappa.size, 0.15), 0.15 * kappa])
    omega = law.sprocket_speeds(twist, GEOMETRY)
    errors = np.random.default_rng(seed).normal(0, noise, omega.shape)
    omega = omega + errors * np.abs(omega).max(axis=1, keepdims=True)
    return SlipSamples.of(omega, twist, GEOMETRY, [str(k) for k in range(kappa.size)])


@pytest.mark.parametrize(
    ("name", "law"),
    [
        ("exponential", PUBLISHED),
        ("icr", ConstantIcr(0.0447, 0.168)),
        ("icr_radius", ConstantIcr(0.0447, 0.168, 0.0067)),
        ("icr_radius", ConstantIcr(-0.02, 0.168, -0.03)),
    ],
)
def test_fits_find_the_law_that_made_the_samples(name, law):
    fit = fit_law(name, samples_of(law), GEOMETRY)
    assert fit.rms < 1e-7
    for key, value in fit.values.items():
        assert value == pytest.approx(getattr(law, key), abs=1e-6)


def test_standard_errors_are_the_scatter_of_the_estimates():
    law = ConstantIcr(0.0447, 0.168, 0.0067)
    kappa = np.tile(KAPPA, 4)
    fits = [fit_law("icr_radius", samples_of(law, kappa, noise=0.001, seed=k), GEOMETRY) for k in range(200)]
    for key in ("offset", "radius_error"):
        scatter = np.std([fit.values[key] for fit in fits])
        stated = np.sqrt(np.mean([fit.stderr[key] ** 2 for fit in fits]))
        assert 0.85 * scatter < stated < 1.5 * scatter  # of 7 commands, errors are on the safe side


def test_too_few_samples_and_unknown_laws():
    with pytest.raises(LogError, match="can't determine its 4 parameters"):
        fit_law("exponential", samples_of(PUBLISHED, KAPPA[:2]), GEOMETRY)
    with pytest.raises(InvalidValueError, match="one of none, constant, exponential"):
        fit_law("cubic", samples_of(PUBLISHED), GEOMETRY)
    with pytest.raises(LogError, match="run 'still': the sprockets stand still"):
        SlipSamples.of(np.zeros((1, 2)), np.array([[0.1, 0.1]]), GEOMETRY, ["still"])


def test_parameters_that_the_samples_do_not_determine_are_not_reported():
    rng = np.random.default_rng(0)
    straight = samples_of(ConstantIcr(0.045, 0.168, 0.01), np.zeros(8))
    for samples in (straight, samples_of(ConstantIcr(0.045, 0.168, 0.01), 1e-4 * rng.normal(size=8), noise=0.002)):
        with pytest.raises(LogError, match="don't determine"):
            compare_laws(samples, GEOMETRY)
    few = compare_laws(samples_of(ConstantIcr(0.045, 0.168, 0.01), KAPPA[:2], noise=1e-4), GEOMETRY)
    assert {"icr", "icr_radius"} <= set(few.laws) <= {"none", "constant", "icr", "icr_radius", "turn_loss"}
    assert {warning.split(":")[0] for warning in few.warnings} >= {"law exponential", "law exponential_speed"}


def test_a_law_takes_radii_that_differ_and_errors_that_are_small():
    law = ConstantIcr(0.045, 0.168)
    for name in ("exponential", "turn_loss"):
        fit_law(name, samples_of(law, 0.5 * (1 + 1e-3 * np.arange(7))), GEOMETRY)
        with pytest.raises(LogError, match="different radii"):  # parameters stand in for each other
            fit_law(name, samples_of(law, 0.5 * (1 + 1e-4 * np.arange(7))), GEOMETRY)
    nearly_straight = np.linspace(-0.01, 0.01, 8)
    assert fit_law("icr", samples_of(law, nearly_straight, noise=0.001), GEOMETRY).stderr["offset"] > 0.05
    with pytest.raises(LogError, match="don't determine offset"):  # standard error 0.28 m
        fit_law("icr", samples_of(law, nearly_straight, noise=0.003), GEOMETRY)


@pytest.mark.parametrize("tight", [0.25, 0.23, 0.19, -0.25])
def test_a_run_tighter_than_the_poles_does_not_trap_the_fit(tight):
    law = ConstantIcr(0.0447, 0.168, 0.0067)
    fit = fit_law("icr_radius", samples_of(law, np.array([0.4, 0.8, 1.6, 1 / tight])), GEOMETRY)
    assert fit.values["offset"] == pytest.approx(0.0447, abs=1e-6)
    assert fit.values["radius_error"] == pytest.approx(0.0067, abs=1e-6)


def trace(law, kappa, duration=20.0, omega_after=1.0):
    twist = np.array([0.15, 0.15 * kappa])
    time = np.arange(0, duration, 0.05)
    omega = np.tile(law.sprocket_speeds(twist, GEOMETRY), (time.size, 1))
    omega[time > duration / 2] *= omega_after
    return RunLog(f"{kappa}", time, omega, advance([0, 0, 0], twist, time))


def test_slip_of_traces():
    law = ConstantIcr(0.045, 0.168, 0.01)
    samples = usable_samples([trace(law, kappa) for kappa in KAPPA], GEOMETRY, longest=True).samples
    np.testing.assert_allclose(samples.slip, law(KAPPA), atol=1e-6)
    np.testing.assert_allclose(samples.radius, 1 / KAPPA, rtol=1e-5)
    np.testing.assert_allclose(body_twist(samples.omega, samples.slip, GEOMETRY), samples.twist)


def test_runs_that_are_not_steady_are_refused():
    law = ConstantIcr(0.045, 0.168)
    with pytest.raises(LogError, match="too short"):
        usable_samples([trace(law, 0.5, duration=1.0)], GEOMETRY, longest=True)
    with pytest.raises(LogError, match="has no truth"):
        true_samples([trace(law, 0.5)], GEOMETRY)
    with pytest.raises(InvalidValueError, match="settle"):
        usable_samples([trace(law, 0.5)], GEOMETRY, settle=-1.0, longest=True)
