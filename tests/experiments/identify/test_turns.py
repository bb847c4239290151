"""Slip of the inner and outer track, with errors propagated to slip and radius."""

import numpy as np
import pytest
from identifications import GEOMETRY, driven, grid

from experiments.identify.turns import Turns, slip_at
from trackslip.laws.exponential import PUBLISHED
from trackslip.laws.icr import IcrSides


def test_left_and_right_turns_have_the_same_inner_and_outer_slips():
    left, right = (Turns.of(driven(grid(side=side)), GEOMETRY) for side in (1, -1))
    assert left.left.all()
    assert not right.left.any()
    for turns in (left, right):
        assert (turns.slip[:, 0] < 0).all()  # the inner track runs slower than it moves
        assert (turns.slip[:, 1] > 0).all()


def test_straight_runs_are_left_out_and_turns_on_the_spot_have_radius_zero():
    turns = Turns.of(driven([(0.1, 0.0), (0.1, 0.1), (0.0, 0.4), (0.0, -0.4)]), GEOMETRY)
    assert len(turns) == 3
    np.testing.assert_allclose(turns.radius, [1, 0, 0], atol=0.02)


def test_errors_are_the_scatter_of_many_measurements():
    many = [Turns.of(driven(np.array([[0.15, 0.12]]), seed=seed), GEOMETRY) for seed in range(3000)]
    assert np.std([each.radius[0] for each in many]) == pytest.approx(many[0].radius_error[0], rel=0.06)
    np.testing.assert_allclose(np.std([each.slip[0] for each in many], axis=0), many[0].slip_error[0], rtol=0.06)


def test_a_law_has_a_curve_for_each_side_that_it_tells_apart():
    radius = np.array([0.5, 1.0, 2.0])
    (curve,) = Turns.of(driven(grid()), GEOMETRY).curves(PUBLISHED, radius)
    np.testing.assert_allclose(curve[:, 0], PUBLISHED.alpha_inner * np.exp(PUBLISHED.beta_inner * radius))
    np.testing.assert_allclose(curve, slip_at(PUBLISHED, radius, 0.1, left=False))
    law = IcrSides(0.03, 0.07, 0.0, 0.01, GEOMETRY.half_gauge)
    for twists, sides in (([*grid(), *grid(side=-1)], 2), (grid(), 1)):
        assert len(Turns.of(driven(twists), GEOMETRY).curves(law, radius)) == sides
