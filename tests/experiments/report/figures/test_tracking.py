"""Figures of tracking, after Figs. 7-12 of the paper, and of predictions."""

from dataclasses import replace

import numpy as np
import pytest
from figures import assert_readable, legend_texts
from identifications import GEOMETRY, driven, grid, identified

from experiments.driving.paper_model import published_runs
from experiments.report.figures import tracking as figures
from experiments.report.figures.predict import MODULI, draw_prediction
from experiments.report.laws import shown
from trackslip.metrics import body_errors
from trackslip.skid_theory import Load, line_contact, steady_turns
from trackslip.trajectory.segmented import paper_reference

START = {"feedforward": paper_reference().pose(0.0), "linear": np.array([0.3, -0.2, np.pi / 3])}


@pytest.fixture(scope="module")
def published():
    return published_runs(START, GEOMETRY)


def test_paths_and_errors_are_those_of_the_runs(published):
    log = published["linear"]["none"]
    ground, _ = assert_readable(figures.paths(published["linear"], published["linear"])).axes
    (line,) = [line for line in ground.lines if line.get_label() == shown("none").label]
    assert (line.get_xdata()[0], line.get_ydata()[0]) == pytest.approx(tuple(log.pose[0, :2]))
    line = assert_readable(figures.tracking_errors_over_time({"none": log}, {})).axes[0].lines[0]
    rows = np.searchsorted(log.time, line.get_xdata())
    expected = body_errors(log.pose, paper_reference().pose(log.time))[rows, 0]
    np.testing.assert_allclose(line.get_ydata(), expected)


def test_slip_of_compensations_whose_law_is_known(published):
    runs = published["linear"]
    laws = identified(driven(grid()), ("icr", "icr_radius")).comparison.laws
    figure = assert_readable(figures.slip_during_tracking(runs | {"icr_radius": runs["published"]}, laws, runs))
    assert len(figure.axes) == 2
    assert "right track, from the law" in legend_texts(figure)
    silent = {name: replace(log, twist_command=None) for name, log in runs.items()}
    assert figures.slip_during_tracking(silent, laws, {}) is None


def test_a_prediction_has_a_line_for_each_modulus_and_a_point_for_each_radius():
    contact, load = line_contact(0.168, 0.17, 0.7, 0.778), Load()
    turns = steady_turns((0.6, 1.5, 3.0), contact, 0.01, load)
    offset, slip = assert_readable(draw_prediction(turns, contact, 0.01, load)).axes
    *lines, points = offset.lines
    assert len(lines) == len(MODULI)
    np.testing.assert_allclose(points.get_ydata(), 1e3 * turns.offset)
    np.testing.assert_allclose(slip.lines[-2].get_ydata(), turns.slip[:, 1])
