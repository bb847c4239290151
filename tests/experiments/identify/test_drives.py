"""Laws identified from whole drives: tables and figures against the fits."""

import re
from dataclasses import replace

import numpy as np
import pytest
from figures import assert_readable

from experiments.common.colours import RED
from experiments.common.laws import shown
from experiments.identify import drive_figures as drives
from experiments.identify import drives as tables


def floats(text):
    return [float(number.replace("−", "-")) for number in re.findall(r"−?\d+\.\d+", text)]


def test_laws_with_errors_and_intervals_the_best_predictions_first(two_drives):
    table = tables.law_table(two_drives.drive)
    laws = [row[0] for row in table.rows if row[0]]
    assert [law.name for law in laws if law.name] == [name for name in two_drives.drive.ranking if name != "none"]
    assert [law.name for law in laws if law.mark] == [two_drives.best]
    _, symbol, *cells = next(row for row in table.rows if row[0] and row[0].name == "icr_radius")
    law = two_drives.drive.laws["icr_radius"]
    expected = [law.values["offset"], law.stderr["offset"], *law.interval95["offset"]]
    assert symbol == "D"
    assert floats(" ".join(cells)) == pytest.approx(1e3 * np.array(expected), rel=0.06)


def test_predictions_are_printed_in_metres_and_degrees(two_drives):
    found = two_drives.drive
    position, heading = tables.position_table(found), tables.heading_table(found)
    errors = found.errors["none"][2.0]
    at = position.header.index(f"2 s, {errors.count:,} pairs")
    assert [row[0].text for row in position.rows][:3] == ["as it drives today", "two gains", position.rows[2][0].text]
    sizes = [errors.position_rms, errors.position_median, errors.position_p90]
    assert floats(position.rows[-1][at]) == pytest.approx(sizes, abs=6e-4)
    degrees = np.degrees([errors.heading_rms, errors.heading_median, errors.heading_p90])
    assert floats(heading.rows[-1][at]) == pytest.approx(degrees, abs=6e-2)
    ratio = re.search(r"heading (\S+) times better than the robot does today", tables.gain(found))[1]
    told = [found.errors[name][2.0].heading_median for name in ("today", found.best)]
    assert float(ratio) == pytest.approx(told[0] / told[1], rel=0.06)


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


def test_long_names_of_laws_fit_below_the_errors(two_drives):
    found, best = two_drives.drive, "centrifugal"
    names = (best, "turn_loss_sides", "turn_loss", "exponential", "icr_radius", "icr_sides", "icr", "none")
    laws, errors = (dict.fromkeys(names, known["icr"]) for known in (found.laws, found.errors))
    assert_readable(drives.prediction_errors(replace(found, best=best, laws=laws, errors=errors)))


def test_the_clock_offset_lies_in_the_valley(two_drives):
    found = two_drives.drive
    (axis,) = assert_readable(drives.clock_offset(found)).axes
    offset, rise = axis.lines[0].get_data()
    assert offset[np.argmin(rise)] == pytest.approx(1e3 * found.laws[found.best].extras["clock_offset"], abs=0.5)
