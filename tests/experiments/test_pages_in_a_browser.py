"""Every command's page in a browser, on a desk and on a phone, light and dark."""

import importlib.util
import itertools

import pytest
from browser import View, address, browser, chromium
from command_runs import ran

from experiments.common.page import Answer, Bullets, Page, Section
from experiments.common.table import Table

pytestmark = [
    pytest.mark.slow,
    pytest.mark.usefixtures("with_figures"),
    pytest.mark.skipif(chromium() is None, reason="no Chromium is installed"),
]

VIEWS = [View(width, dark) for width, dark in itertools.product((1400, 400), (False, True))]
CIRCLE = ("--reference", "circle", "--circle-duration", "14", "--localization", "truth")
GRID = ("--radii", "0.5", "1.5", "--speeds", "0.1", "0.25", "--duration", "6")
PAGES = {
    "reproduce": ("reproduce", *GRID),
    "grid": ("grid", *GRID, "--jobs", "1"),
    "sweep": ("grid", *GRID, "--jobs", "1", "--grounds", "stone", "ice", "--seeds", "0", "1"),
    "one run": ("grid", "--radii", "1", "--speeds", "0.1", "--duration", "6", "--jobs", "1"),
    "plan": (
        *("plan", "--half-gauge", "0.168", "--sprocket-radius", "0.06", "--max-speed", "0.3"),
        *("--duration", "20", "--area", "4x4"),
    ),
    "track": ("track", *CIRCLE),
    "lost": ("track", *CIRCLE, "--controller", "feedforward", "--start", "0", "2", "0"),
    "benchmark": (
        *("benchmark", "--references", "circle", "--starts", "zero", "paper", "--seeds", "0", "1"),
        *("--controllers", "linear", "lqr:period=0.05", "--localization", "truth", "--jobs", "1"),
    ),
    "train": (
        *("train", "--robots", "4", "--horizon", "32", "--batch", "64", "--epochs", "1"),
        *("--network", "8", "--references", "slalom", "--steps", "256"),
    ),
    "wander": ("wander", "--duration", "20", "--drives", "2"),
    "calibrate": ("calibrate", "--free", "friction_ratio", "radius_error"),
    "drive": ("drive", "--course", "step10", "--preset", "fast", "--duration", "3"),
    "validate": ("validate",),
}


@pytest.fixture(scope="module")
def opened():
    with browser() as chrome:
        yield chrome


def assert_shown_well(chrome, file):
    """Assert that a page is as wide as the window, has no errors, and begins with its answer."""
    for view in VIEWS:
        chrome.open(address(file), view)
        wide = chrome.value("document.documentElement.scrollWidth")
        assert wide <= chrome.value("document.documentElement.clientWidth"), view
        assert chrome.errors == [], view
        assert chrome.value("document.querySelector('h1').nextElementSibling.className") in (
            "answer",
            "answer alarm",
        )
        # warnings stand between the heading and everything else
        is_first = "[...document.querySelectorAll('.warnings')].every(list => "
        is_first += "list.previousElementSibling.tagName === 'H2')"
        assert chrome.value(is_first), view
        # all charts are live, and hide the figures for print
        charts = chrome.value("document.querySelectorAll('.zoom').length")
        live = "[...document.querySelectorAll('.zoom')].filter(place => place.firstElementChild)"
        assert chrome.value(f"{live}.length") == charts
        hidden = "[...document.querySelectorAll('.live > svg')].every(svg => !svg.clientWidth)"
        assert chrome.value(hidden), view
        # tables that are wider than the page say so
        wider = "[...document.querySelectorAll('.scroll')].every(part => "
        wider += "part.getBoundingClientRect().right <= document.documentElement.clientWidth)"
        assert chrome.value(wider), view


@pytest.mark.parametrize("name", PAGES)
def test_every_page_fits_and_begins_with_its_answer(name, opened, tmp_path):
    if name == "train" and importlib.util.find_spec("stable_baselines3") is None:
        pytest.skip("Stable-Baselines3 is not installed")
    ran(tmp_path / "out", *PAGES[name])
    file = tmp_path / "out" / "report.html"
    assert file.stat().st_size < 5e6
    assert_shown_well(opened, file)


def test_pages_on_a_drive_fit_and_begin_with_their_answer(opened, tmp_path):
    ran(tmp_path / "log", "wander", "--duration", "60")
    log = str(tmp_path / "log")
    ran(tmp_path / "law", "identify", log)
    ran(tmp_path / "errors", "evaluate", log, "--law", str(tmp_path / "law"), "--law", "none")
    ran(tmp_path / "grid", *PAGES["grid"])
    ran(tmp_path / "steady", "identify", str(tmp_path / "grid"))
    for name in ("law", "errors", "steady"):
        assert_shown_well(opened, tmp_path / name / "report.html")


def test_a_page_with_long_names_and_empty_tables_fits(opened, tmp_path):
    long = "a_name_without_spaces_" * 8
    columns = [f"column {k} [mm]" for k in range(16)]
    wide = Table(long, ["law", *columns], [[long, *("1.234" for _ in columns)]])
    empty = Table("No rows", ["law", "value"], [])
    sections = [Section(long, [long, wide, empty, Bullets([long])]), Section("Nothing", [None])]
    answer = Answer(long, [(long, long)], [long], [long], [long], [long])
    page = Page(long, f"trackslip {long}", {long: long}, sections, [long], answer)
    page.write(tmp_path)
    assert_shown_well(opened, tmp_path / "report.html")


def test_fingers_scroll_the_page_and_a_mouse_moves_the_chart(opened, tmp_path):
    ran(tmp_path / "out", *PAGES["wander"])
    pans = "[...Bokeh.index.roots[0].model.references()].filter(m => m.type === 'PanTool')"
    for touch in (False, True):
        opened.open(address(tmp_path / "out" / "report.html"), View(400, touch=touch))
        assert opened.value(f"{pans}.some(tool => tool.active)") == (not touch)


def test_without_scripts_the_figures_for_print_are_shown(opened, tmp_path):
    ran(tmp_path / "out", *PAGES["wander"])
    file = tmp_path / "out" / "report.html"
    text = file.read_text(encoding="utf-8")
    start = text.index("<script>")
    file.write_text(text[:start], encoding="utf-8")
    opened.open(address(file), View(400))
    shown = "[...document.querySelectorAll('.card > svg')].every(svg => svg.clientWidth > 100)"
    assert opened.value(shown)
    assert opened.value("document.querySelectorAll('.live').length") == 0
