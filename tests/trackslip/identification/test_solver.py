import numpy as np
import pytest
from scipy.optimize import curve_fit
from scipy.optimize import least_squares as scipy_least_squares

from trackslip.identification.solver import least_squares

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


def test_limits_and_held_parameters():
    truth, y = decays(5)
    at_limit = solved(y, low=(-np.inf, -0.2), start=(1.0, -0.1))
    np.testing.assert_array_equal(at_limit.values[truth[:, 1] < -0.3, 1], -0.2)
    best = np.exp(-0.2 * X) @ y.T / np.sum(np.exp(-0.4 * X))
    np.testing.assert_allclose(at_limit.values[:, 0], best, rtol=1e-6)
    held = solved(y, start=(1.0, -0.2), held=np.tile([False, True], (5, 1)))
    np.testing.assert_allclose(held.values[:, 0], best, rtol=1e-6)
    np.testing.assert_array_equal(held.values[:, 1], -0.2)
