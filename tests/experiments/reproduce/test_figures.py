"""Figures of closed loops along the paper's path."""

import numpy as np
import pytest
from figures import assert_readable
from identifications import GEOMETRY

from experiments.reproduce import figures
from experiments.reproduce.paper_model import published_runs
from trackslip.metrics import body_errors
from trackslip.trajectory.segmented import paper_reference


@pytest.fixture(scope="module")
def published():
    start = {"linear": np.array([0.3, -0.2, np.pi / 3])}
    return published_runs(start, GEOMETRY)["linear"]


def test_paths_and_errors_are_those_of_the_runs(published):
    log = published["none"]
    runs = published | {"icr_radius": published["published"]}
    ground, _ = (assert_readable(figure).axes[0] for figure in figures.paths(runs, published))
    (line,) = [line for line in ground.lines if line.get_label() == "none"]
    assert (line.get_xdata()[0], line.get_ydata()[0]) == pytest.approx(tuple(log.pose[0, :2]))
    for figure, factor in zip(figures.tracking_errors_over_time(runs, {}), (1.0, 1e3), strict=True):
        line = assert_readable(figure).axes[0].lines[0]
        rows = np.searchsorted(log.time, line.get_xdata())
        expected = body_errors(log.pose, paper_reference().pose(log.time))[rows, 0]
        np.testing.assert_allclose(line.get_ydata(), factor * expected)
