"""The page of an identification: tables, text and figures of whatever there is data for."""

import html
import re
from dataclasses import replace

import numpy as np
import pytest
from identified import driven, grid, identified
from spin import spun_before_the_scanner

from experiments.report.identification import page
from experiments.report.library import identification_page
from experiments.report.page import Plot
from experiments.report.steady_laws import criteria_table, law_table

OF_LAWS = (
    "fig05_slip_over_speed_and_radius",
    "fig06_slip_laws",
    "residuals_of_laws",
    "comparison_of_laws",
    "correlations_of_parameters",
)
OF_DRIVES = ("drive_path", "drive_prediction_errors", "drive_residuals", "drive_clock_offset", "drive_correlations")


def plots(found):
    return tuple(block.name for block in page(found, "Laws", "", {}).blocks if isinstance(block, Plot))


def text_of(found):
    """The page's words, without figures and tags."""
    bare = re.sub(r"<svg.*?</svg>|<style>.*?</style>|<[^>]*>", " ", identification_page(found), flags=re.DOTALL)
    return html.unescape(" ".join(bare.split()))


@pytest.fixture(scope="module")
def found():
    return identified(driven(grid()), outliers=[("run 9", "it is 0.3 off")])


def test_laws_have_values_errors_and_intervals(found):
    groups, name = {}, ""
    for first, *cells in law_table(found).rows:
        name = first.name if first else name
        groups.setdefault(name, {})[cells[0]] = " ".join(cells[1:])
    assert groups.keys() == {*found.comparison.laws, "published"} - {"none"}
    fitted = found.comparison.laws["icr_radius"]
    for symbol, parameter, factor in (("D", "offset", 1e3), ("ε", "radius_error", 1e2)):
        expected = [fitted.values[parameter], fitted.stderr[parameter], *fitted.interval95[parameter]]
        shown = re.findall(r"-?\d+\.\d+", groups["icr_radius"][symbol].replace("−", "-"))
        assert [float(number) for number in shown] == pytest.approx(factor * np.array(expected), rel=0.06)


def test_laws_are_compared_by_rank(found):
    table = criteria_table(found)
    assert [row[0].name for row in table.rows] == [*found.comparison.ranking, "published"]
    best = found.comparison.laws[found.best]
    (row,) = [row for row in table.rows if row[0].mark]
    assert row[0].name == found.best
    assert float(row[table.header.index("rms")]) == pytest.approx(best.rms, abs=1e-5)
    misses = {row[0].name for row in table.rows[:-1] if row[-1].text == "misses"}
    assert misses == {name for name, law in found.comparison.laws.items() if law.lacks_fit}


@pytest.mark.parametrize(
    "twists",
    [
        grid(side=-1),
        [*grid(), *grid(side=-1), (0.1, 0.0), (0.2, 0.0)],
        [(0.0, 0.4), (0.0, -0.4), (0.0, 0.6), *grid()[:4]],
        [(0.1, 0.1 / radius) for radius in (0.5, 0.7, 1, 1.4, 2, 3, 4, 6, 9, 14)],
    ],
    ids=["right turns", "both sides and straight", "on the spot", "scattered radii"],
)
def test_all_kinds_of_turns_have_a_page(twists):
    found = identified(driven(twists), ("icr", "icr_radius"))
    assert re.findall(r'<figure id="(\w+)"', identification_page(found)) == list(OF_LAWS)


def test_few_straight_or_single_runs_have_a_page():
    straight = identified(driven([(0.1, 0.0), (0.2, 0.0), (0.15, 0.0)]), ("none",), best="none")
    assert plots(straight) == ("comparison_of_laws",)
    single = identified(driven([(0.1, 0.08)]), ("icr",), best="icr", determined=False)
    assert "at observed radii from 1.25 to 1.25 m" in text_of(single)
    samples = driven([(0.1, 0.1), (0.1, 0.2)], errors=False)
    few = text_of(identified(samples, ("constant", "icr", "icr_radius"), determined=False))
    assert "There are no error bars" in few
    assert "nan" not in few.lower().split()


@pytest.mark.parametrize("method", ["steady", "drive"])
def test_drives_follow_steady_runs(found, two_drives, method):
    both = replace(found, drive=two_drives.drive, method=method, logs=(spun_before_the_scanner(400),))
    assert plots(both) == ("fig04_pose_and_velocity", "localization_error", *OF_LAWS, *OF_DRIVES)
    words = text_of(both)
    assert words.count("run 9 : it is 0.3 off.") == 1  # not among the warnings as well
    assert ("the laws above are the result" in words) == (method == "steady")
