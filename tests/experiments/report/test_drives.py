"""Tables of laws identified from whole drives: every law, its intervals, what was held, how well it predicts."""

import re

import numpy as np
import pytest
from wandered import LAWS, compared, wandered

from experiments.report import drives as tables
from experiments.report.formats import MISSING
from experiments.report.laws import law_table


def test_laws_with_errors_and_intervals_the_best_predictions_first(two_drives):
    rows = tables.law_rows(two_drives.drive)
    assert [row.law for row in rows] == list(two_drives.drive.ranking)
    assert [row.law for row in rows if row.best] == [two_drives.best]
    law, symbol, value, interval = law_table([row for row in rows if row.law == "icr_radius"])[0]
    assert (law, symbol) == ("icr_radius", "D")
    found = two_drives.drive.laws["icr_radius"]
    number, error = map(float, re.fullmatch(r"(\S+) ± (\S+) mm", value).groups())
    assert number == pytest.approx(1e3 * found.values["offset"], rel=1e-2)
    assert error == pytest.approx(1e3 * found.stderr["offset"], rel=0.06)
    ends = [float(end) for end in interval.split(" to ")]
    assert ends == pytest.approx([1e3 * end for end in found.interval95["offset"]], rel=1e-2)


def test_sensor_and_clock_in_units_that_people_read(two_drives):
    law = two_drives.drive.laws["icr_radius"]
    rows = {row.symbol: row for row in tables.extra_rows(law)}
    assert list(rows) == ["X", "Y", "c", "τ", "ψ", "T"]
    units = {symbol: row.value.split()[-1] for symbol, row in rows.items()}
    assert units == {"X": "mm", "Y": "mm", "c": "ms", "τ": "ms", "ψ": "°", "T": "ms"}
    yaw = float(rows["ψ"].value.split()[0].replace("−", "-"))
    assert yaw == pytest.approx(np.degrees(law.extras["sensor_yaw"]), abs=0.05)


def test_what_is_held_is_marked_and_the_reason_given(without_headings):
    law = without_headings.drive.laws["icr_radius"]
    rows = {row.symbol: row for row in tables.extra_rows(law)}
    assert rows["ψ"].interval == tables.HELD
    assert rows["ψ"].held == "no headings were measured"
    assert rows["X"].held == ""
    assert "held: ψ (sensor_yaw), no headings were measured" in tables.held_lines(law)


def test_a_held_parameter_of_a_law_is_marked():
    found = compared(wandered(straight=True, duration=15.0), names=("none", "icr_radius"))
    (offset,) = [cells for row in tables.law_rows(found) for cells in row.parameters if cells[0] == "D"]
    assert offset == ("D", "0 mm", "held")
    assert any(
        line.startswith("held: D (offset), not determined") for line in tables.held_lines(found.laws["icr_radius"])
    )


def test_predictions_are_printed_in_metres_and_degrees(two_drives):
    found = two_drives.drive
    rows = tables.prediction_rows(found)
    position, heading = tables.position_table(rows), tables.heading_table(rows)
    assert [row[0] for row in position] == [row[0] for row in heading]
    assert position[-1][0] == "no slip compensation"
    assert {len(row) for row in position} == {len(tables.POSITION_HEADER)}
    assert {len(row) for row in heading} == {len(tables.HEADING_HEADER)}
    errors = found.errors["none"][2.0]
    at = tables.POSITION_HEADER.index("2 s")
    assert position[-1][at] == f"{errors.position_rms:.3f} | {errors.position_median:.3f}"
    assert heading[-1][at] == f"{np.degrees(errors.heading_rms):.2f} | {np.degrees(errors.heading_median):.2f}"


def test_horizons_beyond_the_drive_are_dashes():
    rows = tables.prediction_rows(compared(wandered(duration=8.0), names=("icr",)))
    assert rows[0].position[0] != MISSING
    assert rows[0].position[-1] == rows[0].heading[-1] == MISSING


def test_without_headings_there_is_no_table_of_them(without_headings):
    rows = tables.prediction_rows(without_headings.drive)
    assert tables.heading_table(rows) == []
    facts = tables.DriveFacts.of(without_headings.drive, main=True)
    assert not facts.headings
    assert "heading" not in facts.gain
    assert [name for name, _ in facts.noise if "heading" in name] == []


def test_facts(two_drives):
    facts = tables.DriveFacts.of(two_drives.drive, main=True)
    assert facts.drives == 2
    assert facts.duration == "40 s"
    assert facts.shown == "drive"
    assert facts.left_out >= 4
    assert len(facts.laws) == len(facts.predictions) == len(LAWS)
    ratio = re.search(r"heading (\S+) times better than no slip compensation", facts.gain)[1]
    told = [two_drives.drive.errors[name][2.0].heading_rms for name in ("none", two_drives.best)]
    assert float(ratio) == pytest.approx(told[0] / told[1], rel=0.06)
