"""Figures of whole drives: what they show is what was found."""

import numpy as np
import pytest
from figures import assert_readable

from experiments.report.colours import RED
from experiments.report.figures import drives
from experiments.report.laws import shown


def test_the_path_with_outlying_poses_and_predictions(two_drives):
    found = two_drives.drive
    figure = assert_readable(drives.path_and_predictions(found))
    left, right = figure.axes
    (crosses,) = [line for line in left.lines if line.get_marker() == "x"]
    assert crosses.get_color() == RED
    assert len(crosses.get_xdata()) >= 4
    assert right.get_title(loc="left") == "Predicted 10 s ahead, from the dots"
    colours = {line.get_color() for line in right.lines}
    assert all(shown(name).colour in colours for name in drives.compared(found))


@pytest.mark.parametrize("headings", [True, False])
def test_predicted_paths_end_where_the_errors_say(two_drives, without_headings, headings):
    found = (two_drives if headings else without_headings).drive
    fit, predictions = found.laws["icr"].fit, found.predictions["icr"]
    for k in np.linspace(0, len(predictions.start) - 1, 7).astype(int):
        path = drives.predicted_path(fit, predictions, int(k))
        start = predictions.start[k]
        turn = predictions.heading[k]
        forwards, left = predictions.error[k, :2]
        error = np.array([np.cos(turn) * forwards - np.sin(turn) * left, np.sin(turn) * forwards + np.cos(turn) * left])
        np.testing.assert_allclose(path[0], fit.nodes.pose[start, :2], atol=1e-12)
        np.testing.assert_allclose(path[-1] - error, fit.nodes.pose[start + len(path) - 1, :2], atol=1e-9)


def test_residuals_of_poses_are_of_the_noise_s_size(two_drives):
    law = two_drives.drive.laws["icr_radius"]
    error, kept = drives.pose_residuals(law.fit)
    assert np.std(error[kept, 0]) == pytest.approx(law.noise["position"], rel=0.25)
    assert np.std(error[kept, 2]) == pytest.approx(law.noise["heading"], rel=0.25)
    assert np.hypot(*error[~kept, :2].T).max() > 0.5
    assert len(assert_readable(drives.residuals_over_time(law)).axes) == 3


def test_the_clock_offset_lies_in_the_valley(two_drives):
    found = two_drives.drive
    (axis,) = assert_readable(drives.clock_offset(found)).axes
    offset, rise = axis.lines[0].get_data()
    assert offset[np.argmin(rise)] == pytest.approx(1e3 * found.laws[found.best].extras["clock_offset"], abs=0.5)
