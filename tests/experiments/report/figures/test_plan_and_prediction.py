"""Figures of plans, predictions and trainings."""

from types import SimpleNamespace

import numpy as np
from figures import assert_readable, legend_texts

from experiments.learning.crossing import POLICY, SCRIPTED, CrossingRate, learning_curve
from experiments.report.figures.plan import draw_plan
from experiments.report.figures.predict import MODULI, draw_prediction
from trackslip.planning.limits import DriveLimits
from trackslip.skid_theory import Load, line_contact, steady_turns


def test_a_plan_says_what_its_lines_are():
    plan = SimpleNamespace(
        limits=DriveLimits(0.3, 0.5, (3.0, 3.0), 60.0),
        places=SimpleNamespace(low=np.array([-1.4, -1.4]), size=(2.8, 2.8)),
        path=np.array([[-1.4, -1.4], [1.4, 1.4]]),
        start=np.array([-1.4, -1.4, 0.8]),
        time=np.array([0.0, 30.0, 60.0]),
        speeds=np.array([[0.2, -0.2], [0.3, 0.3], [0.0, 0.0]]),
    )
    figure = assert_readable(draw_plan(plan))
    assert legend_texts(figure)[:4] == ["area", "where it may get to", "expected path", "start"]


def test_a_prediction_has_a_line_for_each_modulus_and_a_point_for_each_radius():
    contact, load = line_contact(0.168, 0.17, 0.7, 0.778), Load()
    turns = steady_turns((0.6, 1.5, 3.0), contact, 0.01, load)
    offset, slip = assert_readable(draw_prediction(turns, contact, 0.01, load)).axes
    *lines, points = offset.lines
    assert len(lines) == len(MODULI)
    np.testing.assert_allclose(points.get_ydata(), 1e3 * turns.offset)
    np.testing.assert_allclose(slip.lines[-2].get_ydata(), turns.slip[:, 1])


def test_a_training_with_and_without_courses():
    curve = [{"steps": 10, "reward": 0.1}, {"steps": 20, "reward": 0.2, "crossed": 0.5}]
    rates = [CrossingRate(name, 0.1, 2, 2, 1.0, 0.3, 1.0, 0, 0, 0, 3.0) for name in (SCRIPTED, POLICY)]
    assert len(assert_readable(learning_curve(curve, rates)).axes) == 3
    assert len(learning_curve(curve).axes) == 1
