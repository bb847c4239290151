"""`trackslip validate --terrain`: the bounds of tracks, their table, figures and summary."""

import contextlib
import io
import json
from pathlib import Path

import numpy as np
import pytest

import models
from experiments.cli import main
from experiments.validation.terrain import engine, obstacles, slopes, steps, suite, turning

BOX = Path(models.__file__).parent / "box_robot.toml"
SMALLER = {
    suite: {"PRESETS": ("accurate",)},
    turning: {"SLOW": ((-0.04, 0.04), (0.04, 0.08)), "STEADY": 1.0, "WATCH": 0.5},
    slopes: {"FRICTIONS": (0.7,), "ROWS": 3, "ROUNDS": 1, "CLIMBING": 1.5, "TILT": 1.0, "HOLD": 0.5},
    steps: {"ROWS": 3, "ROUNDS": 1},
    obstacles: {"ROBOTS": 2, "DURATION": 1.0, "STAIRS_TIME": 0.5},
    engine: {"TIMED": 0.1, "WARM": 0.0, "ROW_TIME": 0.1},
}
"""Constants with which the command takes seconds."""
PARTS = (
    *("slow", "pivot", "centre of mass off", "climbing", "creep", "highest step", "sideways", "backwards"),
    *(
        "stairs, 99th",
        "stairs down, largest",
        "rough ground, largest",
        "warnings",
        "fastest",
        "ten steps",
        "batch",
        "belts",
    ),
)
"""Of the names of the checks."""


def validated(out, *options):
    """The summary of a validation, and what it printed."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        main(["validate", "--terrain", "--out", str(out), *options])
    return json.loads((out / "summary.json").read_text()), printed.getvalue()


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    out = tmp_path_factory.mktemp("quick") / "out"
    with pytest.MonkeyPatch.context() as patch:
        for module, constants in SMALLER.items():
            for name, value in constants.items():
                patch.setattr(module, name, value)
        return out, *validated(out, "--robot", str(BOX), "--seed", "2", "--threads", "1")


def test_every_bound_is_a_check(quick):
    _, summary, _ = quick
    assert {check["name"].partition(": ")[0] for check in summary["checks"]} == {"box, accurate"}
    for check in summary["checks"]:
        low, high = check["bound"] if isinstance(check["bound"], list) else (-np.inf, check["bound"])
        assert check["holds"] == (low <= check["value"] <= (np.inf if high is None else high))
        assert check["unit"] in ("1", "m", "m/s", "rad")
    named = [check["name"] for check in summary["checks"]]
    assert len(set(named)) == len(named)
    for part in PARTS:
        assert any(part in name for name in named), part


def test_turns_and_the_engine_hold_their_bounds_even_in_a_glance(quick):
    """The others need the whole time."""
    holds = {check["name"].partition(": ")[2]: check["holds"] for check in quick[1]["checks"]}
    for name in holds:
        if name.startswith(("ICRs", "D alone", "warnings", "numbers", "sliding")):
            assert holds[name], name


def test_what_is_printed_and_left_behind(quick):
    out, summary, printed = quick
    held = sum(check["holds"] for check in summary["checks"])
    assert f"{held} of {len(summary['checks'])} checks hold" in printed
    assert printed.count(" !") == len(summary["checks"]) - held
    assert "default contact" in printed
    assert json.loads((out / "manifest.json").read_text())["seed"] == 2
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count("<svg ") == len(list((out / "figures").glob("*.svg"))) == 4
    assert "nan" not in page
    assert [one["robot"] for one in summary["robots"]] == ["box"]
    assert summary["default_contact"][0]["turning"]["slow"]["half_width"]


@pytest.mark.slow
def test_the_box_and_the_rescue_robot_hold_every_bound(tmp_path):
    summary, printed = validated(tmp_path / "out")
    robots = {check["name"].partition(": ")[0] for check in summary["checks"]}
    assert robots == {"box, accurate", "box, fast", "rescue, accurate", "rescue, fast"}
    timed = "real time"  # depends on the computer
    assert [check["name"] for check in summary["checks"] if not check["holds"] and timed not in check["name"]] == []
    assert "checks hold" in printed


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--terrain", "--robot", "nowhere.toml"), "nowhere.toml"),
        (("--terrain", "--rrd"), "rrd = True: must be left out with --terrain"),
    ],
)
def test_mistakes_get_one_line(refused, arguments, message):
    assert message in refused("validate", *arguments)
