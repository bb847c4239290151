"""Slip of the inner and outer track, with errors propagated to slip and radius."""

import numpy as np
import pytest
from identifications import GEOMETRY, driven, grid

from experiments.identify.steady_turns import InnerOuterSamples, slip_at
from trackslip.slip.exponential import PUBLISHED
from trackslip.slip.icr import IcrSides


def test_left_and_right_turns_have_the_same_inner_and_outer_slips():
    left, right = (InnerOuterSamples.of(driven(grid(side=side)), GEOMETRY) for side in (1, -1))
    assert left.left.all()
    assert not right.left.any()
    for turns in (left, right):
        assert (turns.slip[:, 0] < 0).all()  # the inner track runs slower than it moves
        assert (turns.slip[:, 1] > 0).all()
    np.testing.assert_allclose(left.residual(PUBLISHED), right.residual(PUBLISHED), atol=0.02)


def test_straight_runs_are_left_out_and_turns_on_the_spot_have_radius_zero():
    turns = InnerOuterSamples.of(driven([(0.1, 0.0), (0.1, 0.1), (0.0, 0.4), (0.0, -0.4)]), GEOMETRY)
    assert len(turns) == 3
    np.testing.assert_allclose(turns.radius, [1, 0, 0], atol=0.02)


def test_errors_are_the_scatter_of_many_measurements():
    twist = np.array([[0.15, 0.12]])
    many = [InnerOuterSamples.of(driven(twist, seed=seed), GEOMETRY) for seed in range(3000)]
    errors = many[0].errors
    assert errors is not None
    assert np.std([one.radius[0] for one in many]) == pytest.approx(errors.radius[0], rel=0.06)
    for track in range(2):
        assert np.std([one.slip[0, track] for one in many]) == pytest.approx(errors.slip[0, track], rel=0.06)


def test_residuals_are_zero_on_the_law_that_drives():
    radius = np.array([0.5, 1.0, 2.0])
    turns = InnerOuterSamples.of(driven(grid()), GEOMETRY)
    (curve,) = turns.curves(PUBLISHED, radius)
    np.testing.assert_allclose(curve[:, 0], PUBLISHED.alpha_inner * np.exp(PUBLISHED.beta_inner * radius))
    np.testing.assert_allclose(curve, slip_at(PUBLISHED, radius, 0.1, left=False))


def test_a_law_of_both_sides_has_a_curve_for_each_that_was_driven():
    law = IcrSides(0.03, 0.07, 0.0, 0.01, GEOMETRY.half_gauge)
    both = InnerOuterSamples.of(driven([*grid(), *grid(side=-1)]), GEOMETRY)
    assert len(both.curves(law, np.array([0.5, 1.0]))) == 2
    assert len(InnerOuterSamples.of(driven(grid()), GEOMETRY).curves(law, np.array([0.5, 1.0]))) == 1
