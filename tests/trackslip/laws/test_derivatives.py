"""Derivatives of twists by the parameters of laws."""

import numpy as np
import pytest
from slip_data import GEOMETRY, grid

from trackslip.laws.derivatives import twist_derivatives
from trackslip.laws.exponential import PUBLISHED
from trackslip.laws.families import FAMILIES


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
