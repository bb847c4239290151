"""The report of a reproduction, and in headless Chromium: a quiet console, nothing that overflows, light and dark."""

import re
from dataclasses import replace

import numpy as np
import pytest
from browser import assert_fits, look_at
from identified import GEOMETRY, driven, grid, identified
from spin import spun_before_the_scanner

from experiments.driving.paper_model import published_runs
from experiments.measuring.grid import RadiusSummary
from experiments.measuring.tracking import TrackingResult
from experiments.report import reproduction as report
from experiments.report.page import Plot
from experiments.report.reproduction import closed_loops, grid_results
from experiments.report.table import Table
from trackslip.metrics import tracking_errors
from trackslip.trajectory.segmented import paper_reference

STONE = {"along": 0.7, "across": 0.778}
RADII = RadiusSummary((0.5, 1.0), np.array([0.6, np.nan]), np.array([0.62, 1.34]), 0.05)


def reproduction():
    """A robot by the paper's equations, as if it had been simulated."""
    start = {"feedforward": paper_reference().pose(0.0), "linear": np.array([0.3, -0.2, np.pi / 3])}
    geometry = {"half_gauge": GEOMETRY.half_gauge, "sprocket_radius": GEOMETRY.sprocket_radius}
    published = published_runs(start, GEOMETRY)
    tracked = [
        replace(log, metadata={"controller": controller, "compensation": compensation, "geometry": geometry})
        for controller, runs in published.items()
        for compensation, log in runs.items()
    ]
    errors = tracking_errors(tracked[-1].time, tracked[-1].pose, paper_reference())
    found = identified(driven(grid()), ("exponential", "icr_radius"))
    loops = closed_loops(found, [TrackingResult("linear", "none", "plate", errors)], tracked, published)
    comparison = Table(
        "Published | simulated", ("", "", ""), [("slip law", "0.07 exp(-0.68 R)", "0.08 exp(-0.9 R)")] * 5
    )
    command = "trackslip reproduce --out " + "a_long_name_without_a_space" * 5
    manifest = {"seed": 3, "ground": STONE, "versions": {"a" * 60: "b" * 200}}
    results = grid_results(found, [spun_before_the_scanner(400)], RADII)
    return report.page(command, manifest, results, comparison, loops, found)


@pytest.fixture(scope="module")
def page():
    return reproduction().html()


def test_a_whole_report_fits_phone_and_desk(page):
    assert [frame["figures"] for frame in assert_fits(page).frames] == [14, 14]


def test_every_figure_of_a_reproduction_is_there(page):
    names = [block.name for block in reproduction().blocks if isinstance(block, Plot)]
    assert re.findall(r'<figure id="(\w+)"', page) == names
    assert [int(number) for number in re.findall(r"fig(\d\d)_", " ".join(names))] == [4, 5, 6, 7, 8, 9, 10, 11, 12]
    assert "data:image" not in page  # a bitmap would not survive the renaming of ids


def test_dark_and_light(page):
    light, dark = (look_at(page, (1400,), dark=dark).frames[0] for dark in (False, True))
    assert light["background"] == "rgb(251, 251, 250)"
    assert dark["background"] == "rgb(23, 24, 26)"
    assert light["card"] == "rgb(255, 255, 255)"
    assert dark["card"] == "rgb(26, 26, 26)"
