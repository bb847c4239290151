"""Error bars as one line with gaps."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from experiments.report.figures.axes import BARS, draw_bars

X, Y = np.array([1.0, 2.0, 4.0]), np.array([0.1, -0.2, 0.3])
X_ERROR, Y_ERROR = np.array([0.2, 0.1, 0.3]), np.array([0.03, 0.02, 0.01])


@pytest.mark.parametrize("level", [True, False])
def test_bars_reach_an_error_to_either_side(level):
    axes = Figure().subplots()
    draw_bars(axes, X, Y, X_ERROR if level else None, Y_ERROR)
    (line,) = axes.lines
    assert line.get_color() == BARS["color"]
    ends = line.get_xydata().reshape(-1, 3, 2)
    assert np.isnan(ends[:, 2]).any(axis=1).all()
    upright = [((x, y - error), (x, y + error)) for x, y, error in zip(X, Y, Y_ERROR, strict=True)]
    flat = [((x - error, y), (x + error, y)) for x, y, error in zip(X, Y, X_ERROR, strict=True)]
    np.testing.assert_allclose(ends[:, :2], [*upright, *(flat if level else [])])
