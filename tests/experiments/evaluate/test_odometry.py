"""The page of odometry errors: figures and tables against the evaluation."""

import numpy as np
import pytest
from drives import EXACT, GEOMETRY, ICR, STILL, drive_log
from figures import assert_readable

from experiments.common.laws import shown
from experiments.common.page import Plot
from experiments.common.table import Table
from experiments.evaluate import odometry_figures as figures
from experiments.evaluate.odometry import clock_doubt, clock_words, evaluated
from experiments.evaluate.odometry_page import gain, page, tables
from sim.wander.pose_source import PoseSource
from trackslip.odometry.identified import LawInUse, no_slip
from trackslip.slip.icr import ConstantIcr

LAWS = [
    ("icr", LawInUse("icr", ConstantIcr(0.06, GEOMETRY.half_gauge), GEOMETRY)),
    ("none", no_slip(GEOMETRY)),
    ("other:icr", LawInUse("icr", ICR, GEOMETRY)),
]


def found_on(*logs, clock_offset=0.0):
    return evaluated(LAWS, logs, clock_offset=clock_offset)


@pytest.fixture(scope="module")
def found():
    return found_on(drive_log(0, 20.0, EXACT, STILL), drive_log(1, 50.0, EXACT, STILL))


@pytest.fixture(scope="module")
def blind():
    return found_on(drive_log(1, 50.0, PoseSource(rate=5.0, heading=False), STILL))


def test_paths_of_the_longest_drive(found, blind):
    left, right = assert_readable(figures.paths(found)).axes
    measured, *laws = left.lines
    drive = found[0].errors.trajectories[1]
    np.testing.assert_array_equal(measured.get_xdata(), drive.measured[:, 0])
    for line, one in zip(laws, found, strict=True):
        placed = one.errors.trajectories[1].placed
        np.testing.assert_array_equal(line.get_ydata(), placed[:, 1])
        np.testing.assert_array_equal(placed[0], drive.measured[0])
        assert line.get_color() == shown(one.used.name).colour
    worst = [np.nanmax(line.get_ydata()) for line in right.lines]
    np.testing.assert_allclose(worst, [one.errors.drives[1].from_first.position.largest for one in found])
    assert_readable(figures.paths(blind))


def test_errors_over_the_way(found, blind):
    position, _ = assert_readable(figures.errors_over_way(found)).axes
    for line, one in zip(position.lines, found, strict=True):
        expected = [100 * errors.position_per_way for errors in one.errors.after_metres.values()]
        np.testing.assert_allclose(line.get_ydata(), expected)
        np.testing.assert_array_equal(line.get_xdata(), [*one.errors.after_metres])
    assert len(assert_readable(figures.errors_over_way(blind)).axes) == 1


def test_the_page_holds_figures_tables_and_notes(found, blind):
    made = page(found, ["a note"], ["The sensor sits here."], {"seed": 0, "config": {}}, "trackslip evaluate x", "x")
    blocks = list(made.blocks)
    assert [block.name for block in blocks if isinstance(block, Plot)] == ["odometry_paths", "odometry_errors_over_way"]
    assert [block for block in blocks if isinstance(block, Table)] == tables(found)
    assert all(part in made.html() for part in ("a note", "The sensor sits here.", "2 drives", gain(found)))
    assert gain(found).startswith("other:icr, after ")
    assert not any(table.title.startswith("Heading") for table in tables(blind))


def test_clocks_that_disagree_raise_a_doubt():
    logs = [drive_log(3, 20.0, EXACT, STILL)]
    assert clock_doubt(found_on(*logs)[2:], logs) == []
    (line,) = clock_doubt(found_on(*logs, clock_offset=0.2)[2:], logs)
    assert line.endswith("the poses', not 200 ms ahead of the poses': try --clock-offset 0.000")


def test_an_offset_of_the_clocks_is_worded_in_one_way():
    assert [clock_words(offset) for offset in (-0.1076, 0.02, -1e-9)] == [
        "108 ms behind the poses'",
        "20 ms ahead of the poses'",
        "0 ms ahead of the poses'",
    ]
