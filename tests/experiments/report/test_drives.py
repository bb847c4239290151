"""Tables of laws identified from whole drives: every law, its intervals, what was held, how well it predicts."""

import re

import numpy as np
import pytest

from experiments.report import drives as tables


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


def test_a_held_parameter_is_marked_and_the_reason_given(without_headings):
    law = without_headings.drive.laws["icr_radius"]
    intervals = {symbol: interval for _, symbol, _, interval in tables.extra_table(law).rows}
    assert (intervals["ψ"].name, intervals["ψ"].text) == ("held", "held: no headings were measured")
    assert isinstance(intervals["X"], str)
    assert "held: ψ (sensor_yaw), no headings were measured" in tables.held_lines(law)


def test_predictions_are_printed_in_metres_and_degrees(two_drives):
    found = two_drives.drive
    position, heading = tables.position_table(found), tables.heading_table(found)
    errors = found.errors["none"][2.0]
    at = position.header.index("2 s")
    assert floats(position.rows[-1][at]) == pytest.approx([errors.position_rms, errors.position_median], abs=6e-4)
    degrees = np.degrees([errors.heading_rms, errors.heading_median])
    assert floats(heading.rows[-1][at]) == pytest.approx(degrees, abs=6e-3)
    ratio = re.search(r"heading (\S+) times better than no slip compensation", tables.gain(found))[1]
    told = [found.errors[name][2.0].heading_rms for name in ("none", found.best)]
    assert float(ratio) == pytest.approx(told[0] / told[1], rel=0.06)
