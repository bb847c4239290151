import numpy as np
import pytest
from scipy.optimize import curve_fit
from scipy.optimize import least_squares as scipy_least_squares
from slip_data import GEOMETRY, grid

from trackslip.identification.intervals import profile_intervals
from trackslip.identification.solver import least_squares
from trackslip.identification.steady_fit import fit
from trackslip.identification.weighting import WeightedRuns
from trackslip.slip.derivatives import twist_derivatives
from trackslip.slip.exponential import PUBLISHED
from trackslip.slip.families import FAMILIES

X = np.linspace(0, 3, 20)


def decays(sets, seed=0):
    rng = np.random.default_rng(seed)
    truth = np.column_stack([rng.uniform(0.5, 2, sets), rng.uniform(-2, -0.3, sets)])
    return truth, truth[:, :1] * np.exp(truth[:, 1:] * X) + rng.normal(0, 0.02, (sets, X.size))


def solved(y, start=(1.0, -1.0), low=(-np.inf, -10.0), high=(np.inf, 0.0), held=None):
    def residual(values, rows):
        return values[:, :1] * np.exp(values[:, 1:] * X) - y[rows]

    begin = np.tile(start, (len(y), 1))
    return least_squares(residual, begin, np.array(low), np.array(high), np.ones(2), held)


def test_many_problems_are_each_solved_as_scipy_solves_one():
    _, y = decays(30)
    found = solved(y)
    for k in range(30):
        values, covariance = curve_fit(lambda x, a, b: a * np.exp(b * x), X, y[k], (1.0, -1.0), sigma=np.ones(20))
        np.testing.assert_allclose(found.values[k], values, atol=1e-6)
        variance = found.cost[k] / 18
        np.testing.assert_allclose(variance * np.linalg.inv(found.hessian[k]), covariance, rtol=1e-3)


def test_a_problem_does_not_depend_on_its_neighbours():
    _, y = decays(8)
    together = solved(y)
    for k in range(8):
        np.testing.assert_allclose(solved(y[k : k + 1]).values[0], together.values[k], rtol=1e-12)


def test_a_minimum_with_large_residuals_is_scipys():
    """Gauss and Newton alone would cross it again and again."""
    x = np.linspace(-1, 1, 30)
    y = 3.0 * np.cos(5 * x)  # far from any exponential

    def residual(values, rows):
        return values[:, :1] * np.exp(values[:, 1:] * x) - y

    start, bounds = np.array([[-1.0, 1.0]]), (np.full(2, -5.0), np.full(2, 5.0))
    found = least_squares(residual, start, *bounds, np.ones(2))
    theirs = scipy_least_squares(lambda v: v[0] * np.exp(v[1] * x) - y, start[0], bounds=bounds, xtol=1e-14, ftol=1e-14)
    assert found.cost[0] == pytest.approx(2 * theirs.cost, rel=1e-8)
    np.testing.assert_allclose(found.values[0], theirs.x, atol=1e-3)


@pytest.mark.parametrize("name", [name for name, family in FAMILIES.items() if family.names])
def test_slopes_of_twists_are_those_of_finite_differences(name):
    family, step = FAMILIES[name], 1e-5
    samples = grid(PUBLISHED, errors=None)
    values = family.starts(GEOMETRY.half_gauge)
    slopes = twist_derivatives(family, values, samples.omega, GEOMETRY)

    def twist(values):
        return family.law(values[:, None, :], GEOMETRY).twist(samples.omega, GEOMETRY)

    for k, only in enumerate(step * np.eye(values.shape[1])):
        difference = (twist(values + only) - twist(values - only)) / (2 * step)
        np.testing.assert_allclose(slopes[..., k], difference, atol=1e-4 * np.abs(difference).max())


@pytest.mark.parametrize("name", ["exponential", "exponential_speed"])
def test_slopes_of_turns_in_place_are_those_of_finite_differences(name):
    """Where slips jump between left and right turns in place, twists still depend on the law."""
    family, step = FAMILIES[name], 1e-5
    omega = np.array([[-3.0, 3.0], [4.0, -4.0], [-3.0, 3.05], [1.0, 3.0]])
    values = family.starts(GEOMETRY.half_gauge)
    slopes = twist_derivatives(family, values, omega, GEOMETRY)
    ahead, behind = (
        np.stack(
            [
                family.law((values + s * only)[:, None, :], GEOMETRY).twist(omega, GEOMETRY)
                for only in np.eye(len(values[0]))
            ]
        )
        for s in (step, -step)
    )
    difference = np.moveaxis((ahead - behind) / (2 * step), 0, -1)
    np.testing.assert_allclose(slopes, difference, atol=1e-4 * np.abs(difference).max())
    assert np.abs(difference[:, 0]).max() > 0.1


def test_limits_and_held_parameters():
    truth, y = decays(5)
    at_limit = solved(y, low=(-np.inf, -0.2), start=(1.0, -0.1))
    np.testing.assert_array_equal(at_limit.values[truth[:, 1] < -0.3, 1], -0.2)
    best = np.exp(-0.2 * X) @ y.T / np.sum(np.exp(-0.4 * X))
    np.testing.assert_allclose(at_limit.values[:, 0], best, rtol=1e-6)
    held = solved(y, start=(1.0, -0.2), held=np.tile([False, True], (5, 1)))
    np.testing.assert_allclose(held.values[:, 0], best, rtol=1e-6)
    np.testing.assert_array_equal(held.values[:, 1], -0.2)


def test_at_the_ends_of_profile_intervals_scipy_finds_the_rise_that_they_promise():
    samples = grid(PUBLISHED, errors=np.diag([2e-3, 4e-3]) ** 2)
    family = FAMILIES["exponential"]
    runs = WeightedRuns.of(samples, GEOMETRY)
    fits = fit(family, runs, scatter=np.zeros(1))
    ends = profile_intervals(fits, np.full((1, 4), 1.96**2))[0]

    def residual(values):
        law = family.law(values, GEOMETRY)
        return runs.whiten(runs.deviation(law), np.zeros(1)).ravel()

    best = scipy_least_squares(residual, [0.05, -1.0, -0.1, -1.0], x_scale="jac")
    np.testing.assert_allclose(best.x, fits.values[0], rtol=1e-4)
    for k in range(len(family.names)):
        for end in ends[k]:
            at_end = scipy_least_squares(
                lambda others, k=k, end=end: residual(np.insert(others, k, end)), np.delete(best.x, k), x_scale="jac"
            )
            assert 2 * (at_end.cost - best.cost) == pytest.approx(1.96**2, rel=0.01)
