"""The page of an identification from whole drives, alone and beside one from steady stretches."""

import html
import re
from dataclasses import replace

import pytest
from browser import assert_fits
from identified import driven, grid, identified

from experiments.report.laws import shown
from experiments.report.library import identification_page
from experiments.report.reproduction import Report, render

OF_DRIVES = ["drive_path", "drive_prediction_errors", "drive_residuals", "drive_clock_offset", "drive_correlations"]


def text_of(page):
    bare = re.sub(r"<svg.*?</svg>|<style>.*?</style>|<[^>]*>", " ", page, flags=re.DOTALL)
    return html.unescape(" ".join(bare.split()))


def figures_in(page):
    return re.findall(r'<figure id="(\w+)"', page)


@pytest.fixture(scope="module")
def page(two_drives):
    return render(Report(title="Laws", command="trackslip identify", manifest={}, identification=two_drives)).html


def test_a_page_of_drives_alone(page, two_drives):
    assert figures_in(page) == OF_DRIVES
    assert page.count("<svg") == len(OF_DRIVES)
    words = text_of(page)
    assert "Measured slip" not in words
    assert "Every pose and every encoder reading of 2 drives counts here (40 s," in words
    assert "b = 0.168 m is half the distance" in words
    assert words.count("no slip compensation") >= 4
    for heading in (
        "Which law predicts motion",
        "Sensor and clock",
        "position, rms | median [m]",
        "heading, rms | median [°]",
    ):
        assert heading in words
    assert re.search(r"D \d+\.\d+ ± \d+\.\d+ mm \d+\.\d+ to \d+\.\d+", words)
    assert f"held: {two_drives.drive.laws[two_drives.best].held['lag']}" in words


def test_it_fits_phone_and_desk(page):
    assert_fits(page)


def test_without_headings(without_headings):
    page = identification_page(without_headings)
    words = text_of(page)
    assert set(figures_in(page)) <= set(OF_DRIVES)
    assert "poses without headings" in words
    assert "heading, rms" not in words
    assert "held: no headings were measured" in words
    assert "the first half of the drive" in words


@pytest.mark.parametrize("method", ["steady", "drive"])
def test_both_stand_on_one_page(two_drives, method):
    steady = identified(driven(grid()), outliers=[("run 9", "it is 0.3 off")])
    page = identification_page(replace(steady, drive=two_drives.drive, method=method))
    assert figures_in(page)[-len(OF_DRIVES) :] == OF_DRIVES
    assert "fig06_slip_laws" in figures_in(page)
    words = text_of(page)
    assert words.count("run 9 : it is 0.3 off.") == 1
    assert words.count("half the distance between the tracks' centre lines") == 1
    assert ("the laws above are the result" in words) == (method == "steady")
    assert words.count(f"{shown('icr_radius').title} best") >= 2


def test_what_was_left_out_and_warnings_are_listed_once(two_drives):
    warning = "3 step(s) of the poses are left out"
    words = text_of(identification_page(replace(two_drives, warnings=(warning,))))
    assert words.count(f"{warning}.") == 1
