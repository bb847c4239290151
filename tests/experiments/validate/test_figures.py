import numpy as np
import pytest
from figures import assert_readable

from experiments.common.check import Check
from experiments.validate.checks import SLIDING_BOUND, SLIP_BOUND
from experiments.validate.figures import checks_figure, deviations
from experiments.validate.measurements import Turns
from trackslip.kinematics import RobotGeometry

CHECKS = [
    Check("box", "b + D in turns", 0.21, 0.01, "m", 0.205),
    Check("box", "load of a contact point, over the mean", 1.2, 0.05, "1", 1.0),
    Check("box", "work of the belts", float("nan"), 1.0, "J", 5.0),
]


def test_each_check_is_drawn_as_a_share_of_its_bound():
    (axes,) = assert_readable(checks_figure(CHECKS)).axes
    marks = [line for line in axes.lines if line.get_marker() == "o"]
    shares = [float(line.get_xdata()[0]) for line in marks]
    assert shares[:2] == pytest.approx([0.5, 4.0])
    assert np.isnan(shares[2])
    low, high = axes.get_xlim()
    assert low < -4 < 4 < high
    names = [text.get_text() for text in axes.get_yticklabels()]
    assert names[1].replace("\n", " ") == "load of a contact point, over the mean: failed"


def test_deviations_are_drawn_with_their_bounds():
    radius = np.array([0.5, 1.0])
    speed = np.array([0.1, 0.1])
    omega = np.array([[1.0, 2.0], [1.5, 2.0]])
    twist = np.array([[0.09, 0.0, 0.15], [0.1, 0.0, 0.08]])
    twists = np.stack([twist, twist * 1.001])
    turns = Turns(omega, 0.06 * omega, twists, RobotGeometry(0.168, 0.06))
    slopes = np.radians([37.0, 38.0])
    expected = np.array([0.4, 0.6])
    sliding = {"downhill": np.stack([slopes, expected, expected + 0.01])}
    inner, outer, slope = map(assert_readable, deviations(turns, radius, speed, sliding))
    for track, figure in enumerate((inner, outer)):
        (axes,) = figure.axes
        drawn = axes.lines[0].get_ydata()
        np.testing.assert_allclose(drawn, turns.slip[1, :, track] - turns.slip[0, :, track])
        top = axes.collections[0].get_datalim(axes.transData).ymax
        assert top == pytest.approx(SLIP_BOUND)
    (axes,) = slope.axes
    np.testing.assert_allclose(axes.lines[0].get_ydata(), 0.01)
    top = axes.collections[0].get_datalim(axes.transData).ymax
    assert top == pytest.approx(SLIDING_BOUND * 0.6)
    assert len(deviations(turns, radius, speed, {})) == 2
