"""`trackslip validate`: the bounds that the simulator and tracks on terrain must keep, and the reports."""

import contextlib
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from browser import assert_fits

import models
from experiments.cli import main
from experiments.report.formats import significant
from experiments.validation import numerics, theory, turning
from experiments.validation.terrain import engine, obstacles, slopes, steps, suite
from experiments.validation.terrain import turning as terrain_turning

SMALLER = {
    turning: {"RATIOS": (0.7, 1.4), "LENGTHS": (1.0,), "CENTRES_OF_MASS": ((0.0, 0.0), (-0.05, 0.1))},
    theory: {"SPEEDS": (0.05, 0.25)},
    numerics: {
        "ROBOTS": 4,
        "DURATION": 6.0,
        "STEPS": (0.002, 0.005, 0.01),
        "REFERENCE_STEP": 0.001,
        "ENERGY_DURATION": 3.0,
    },
}
"""Constants with which the command takes seconds."""
SMALLER_TERRAIN = {
    suite: {"PRESETS": ("accurate",)},
    terrain_turning: {"SLOW": ((-0.04, 0.04), (0.04, 0.08)), "STEADY": 1.0, "WATCH": 0.5},
    slopes: {"FRICTIONS": (0.7,), "ROWS": 3, "ROUNDS": 1, "CLIMBING": 1.5, "TILT": 1.0, "HOLD": 0.5},
    steps: {"ROWS": 3, "ROUNDS": 1},
    obstacles: {"ROBOTS": 2, "DURATION": 1.0, "STAIRS_TIME": 0.5},
    engine: {"TIMED": 0.1, "WARM": 0.0, "ROW_TIME": 0.1},
}
"""Constants with which the command takes seconds."""
PARTS = (
    *("slow", "pivot", "centre of mass off", "climbing", "creep", "highest step", "sideways", "backwards"),
    *("stairs, 99th", "stairs down, largest", "rough ground, largest", "warnings", "fastest", "ten steps"),
    *("batch", "belts"),
)
"""Of the names of the checks on terrain."""
BOX = Path(models.__file__).parent / "box_robot.toml"
FIGURES = {"turns": 2, "left": 2, "slip": 2, "loads": 2, "slopes": 2, "steps": 1, "energy": 2}
"""And of how many panels each is."""


def validated(out, *options, smaller=()):
    """The folder of a validation, and what it printed; with the constants of modules in `smaller`."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), pytest.MonkeyPatch.context() as patch:
        for module, constants in dict(smaller).items():
            for name, value in constants.items():
                patch.setattr(module, name, value)
        main(["validate", "--out", str(out), *options])
    return out, printed.getvalue()


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    return validated(tmp_path_factory.mktemp("quick") / "out", "--seed", "3", smaller=SMALLER)


@pytest.fixture(scope="module")
def terrain(tmp_path_factory):
    """The same for a box on terrain, and its summary."""
    options = ("--terrain", "--robot", str(BOX), "--seed", "2", "--threads", "1")
    folder, printed = validated(tmp_path_factory.mktemp("terrain") / "out", *options, smaller=SMALLER_TERRAIN)
    return folder, printed, summary_of(folder)


def summary_of(folder):
    return json.loads((folder / "summary.json").read_text())


def page_of(folder):
    return (folder / "report.html").read_text(encoding="utf-8")


def assert_within_bounds(found):
    """What holds of any robot that stands evenly on its tracks."""
    assert [check["name"] for check in found["checks"] if not check["holds"]] == []
    assert len(found["checks"]) == 12
    assert all(check["source"] for check in found["checks"])
    assert found["naive_icr_error"]["worst"] > found["naive_icr_error"]["median"] > 0.1
    steps, errors = (np.array([entry[key] for entry in found["timestep"]]) for key in ("dt", "position_error_mm"))
    assert np.all(np.diff(steps) > 0)
    assert np.all(np.diff(errors) > 0)
    assert errors.min() > 0


def assert_report_is_whole(page):
    for name, panels in FIGURES.items():
        figure = re.search(rf'<figure id="{name}">.*?</figure>', page, re.DOTALL)
        assert figure is not None
        assert figure[0].count("<svg ") == panels
        assert figure[0].count("<figcaption>") == 1
    assert page.count("<svg ") == sum(FIGURES.values())
    for reference in re.findall(r'(?:src|href)="([^"]*)"', page):
        assert reference.startswith("#")
    for needle in ("<script", "<link", "@import", "url(http", "nan", "None</"):
        assert needle not in page
    assert len(page.encode()) < 1.5e6


def test_numbers(quick):
    found = summary_of(quick[0])
    assert_within_bounds(found)
    assert found["turns"] == 2 * 3 * 10
    assert [entry["dt"] for entry in found["timestep"]] == [0.002, 0.005, 0.01]
    for key in ("icr_error", "naive_icr_error"):
        assert set(found[key]) == {"worst", "median"}
    stages = {"turning", "turning, default contact", "standing", "convergence", "energy"}
    assert set(found["timing"]["stages"]) == stages


def test_what_is_left_behind(quick):
    folder, printed = quick
    assert {path.name for path in folder.iterdir()} == {"manifest.json", "summary.json", "report.html", "figures"}
    manifest = json.loads((folder / "manifest.json").read_text())
    assert manifest["seed"] == 3
    assert manifest["robot"]["half_gauge"] == 0.168
    assert manifest["ground"]["along"] == 0.7
    assert len(manifest["model_sha256"]) == 64
    found = summary_of(folder)
    assert significant(100 * found["icr_error"]["worst"]) in printed
    assert significant(found["creep_mm_per_s"], "mm/s") in printed
    assert "12 of 12 checks hold" in printed


def test_the_report_is_whole_and_needs_no_network(quick):
    assert_report_is_whole(page_of(quick[0]))
    assert len(list((quick[0] / "figures").glob("*.svg"))) == page_of(quick[0]).count("<svg ")


def test_the_report_fits_phone_and_desk(quick):
    assert_fits(page_of(quick[0]))


def test_the_report_shows_the_numbers(quick):
    page, found = page_of(quick[0]), summary_of(quick[0])
    text = re.sub(r"\s+", " ", re.sub(r"<svg .*?</svg>|<[^>]*>", " ", page, flags=re.DOTALL))
    for value, unit in (
        (100 * found["icr_error"]["median"], "%"),
        (100 * found["naive_icr_error"]["median"], "%"),
        (100 * found["energy_residual"], "%"),
        (found["creep_mm_per_s"], "mm/s"),
        (found["solver_difference_mm"], "mm"),
    ):
        shown = re.findall(rf"(?<![\d.])(\d+\.?\d*) {re.escape(unit)}(?![\w/])", text)
        assert any(abs(float(number) - value) <= 0.051 * value for number in shown)
    assert "60 steady turns" in text
    assert "seed 3" in text


@pytest.mark.slow
@pytest.mark.parametrize("robot", [None, "half_gauge = 0.25\ncontact_length = 0.5\n"], ids=["shipped", "wide"])
def test_robots_within_bounds(tmp_path, robot):
    file = tmp_path / "robot.toml"
    file.write_text(robot or "")
    folder, _ = validated(tmp_path / "out", *(() if robot is None else ("--robot", str(file))))
    found = summary_of(folder)
    assert_within_bounds(found)
    assert robot or found["turns"] == 1200
    assert [entry["dt"] for entry in found["timestep"]] == [0.0005, 0.001, 0.002, 0.005, 0.01]
    assert_report_is_whole(page_of(folder))


def test_every_bound_on_terrain_is_a_check(terrain):
    *_, summary = terrain
    assert {check["name"].partition(": ")[0] for check in summary["checks"]} == {"box, accurate"}
    for check in summary["checks"]:
        low, high = check["bound"] if isinstance(check["bound"], list) else (-np.inf, check["bound"])
        assert check["holds"] == (low <= check["value"] <= (np.inf if high is None else high))
        assert check["unit"] in ("1", "m", "m/s", "rad")
    named = [check["name"] for check in summary["checks"]]
    assert len(set(named)) == len(named)
    for part in PARTS:
        assert any(part in name for name in named), part


def test_turns_and_the_engine_hold_their_bounds_even_in_a_glance(terrain):
    """The others need the whole time."""
    holds = {check["name"].partition(": ")[2]: check["holds"] for check in terrain[2]["checks"]}
    for name in holds:
        if name.startswith(("ICRs", "D alone", "warnings", "numbers", "sliding")):
            assert holds[name], name


def test_what_terrain_prints_and_leaves_behind(terrain):
    out, printed, summary = terrain
    held = sum(check["holds"] for check in summary["checks"])
    assert f"{held} of {len(summary['checks'])} checks hold" in printed
    assert printed.count(" !") == len(summary["checks"]) - held
    assert "default contact" in printed
    assert json.loads((out / "manifest.json").read_text())["seed"] == 2
    page = page_of(out)
    assert page.count("<svg ") == len(list((out / "figures").glob("*.svg"))) == 4
    assert "nan" not in page
    assert [one["robot"] for one in summary["robots"]] == ["box"]
    assert summary["default_contact"][0]["turning"]["slow"]["half_width"]


@pytest.mark.slow
def test_the_box_and_the_rescue_robot_hold_every_bound(tmp_path):
    folder, printed = validated(tmp_path / "out", "--terrain")
    summary = summary_of(folder)
    robots = {check["name"].partition(": ")[0] for check in summary["checks"]}
    assert robots == {"box, accurate", "box, fast", "rescue, accurate", "rescue, fast"}
    timed = "real time"  # depends on the computer
    assert [check["name"] for check in summary["checks"] if not check["holds"] and timed not in check["name"]] == []
    assert "checks hold" in printed


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--seed", "-1"), "seed = -1: must be an integer >= 0"),
        (("--threads", "-1"), "threads = -1"),
        (("--robot", "nowhere.toml"), "nowhere.toml: No such file"),
        (("--terrain", "--robot", "nowhere.toml"), "nowhere.toml"),
        (("--terrain", "--rrd"), "rrd = True: must be left out with --terrain"),
    ],
)
def test_mistakes_get_one_line(refused, arguments, message):
    assert message in refused("validate", *arguments)
