"""Figures of tracking, after Figs. 7-12 of the paper: runs by the paper's equations, as if they had been simulated."""

from dataclasses import replace

import numpy as np
import pytest
from figures import assert_readable, legend_texts
from identified import GEOMETRY, driven, grid, identified

from experiments.driving.paper_model import published_runs
from experiments.report.figures import tracking as figures
from experiments.report.laws import shown
from trackslip.metrics import body_errors
from trackslip.trajectory.segmented import paper_reference

START = {"feedforward": paper_reference().pose(0.0), "linear": np.array([0.3, -0.2, np.pi / 3])}


@pytest.fixture(scope="module")
def published():
    return published_runs(START, GEOMETRY)


def test_planned_trajectory_and_definition_of_errors():
    position, heading = assert_readable(figures.planned_trajectory()).axes
    reference = paper_reference()
    assert position.lines[0].get_ydata()[-1] == pytest.approx(reference.pose(reference.duration)[0])
    assert heading.lines[0].get_ydata()[0] == pytest.approx(np.pi / 2)
    assert_readable(figures.errors_defined())


@pytest.mark.parametrize("controller", list(START))
def test_paths_and_distances_from_the_reference(published, controller):
    runs = published[controller]
    ground, distance = assert_readable(figures.paths(runs, runs)).axes
    log = runs["none"]
    (line,) = [line for line in ground.lines if line.get_label() == shown("none").label]
    assert (line.get_xdata()[0], line.get_ydata()[0]) == pytest.approx(tuple(log.pose[0, :2]))
    assert distance.get_yscale() == "log"


def test_errors_over_time_are_those_of_the_body_frame(published):
    log = published["linear"]["none"]
    figure = assert_readable(figures.tracking_errors_over_time({"none": log}, {}))
    line = figure.axes[0].lines[0]
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
