import json
from pathlib import Path

import numpy as np
import pytest

from experiments import tune
from experiments.benchmark.drive import ClosedLoops
from experiments.benchmark.gains import Gains
from experiments.common.lookup import controller, tunable
from experiments.tune import Config
from sim.robot.parameters import RobotParameters

ROWS = [
    {"controller": "linear", "compensation": "icr_radius", "arguments": {"stiffness": 40.0}},
    {
        "controller": "linear",
        "compensation": "online",
        "arguments": {"stiffness": 60.0, "damping": 1.0},
    },
]
NEVER = """
from trackslip.controllers.feedback import Kanayama
class Never(Kanayama):
    def twist(self, time, pose, reference): raise ValueError("does not work yet")
"""
QUICK = ("--localization", "truth", "--threads", "1", "--compensations", "none")


def test_a_controller_gets_gains_of_its_or_a_like_compensation(tmp_path):
    (tmp_path / "gains.json").write_text(json.dumps({"gains": ROWS}))
    gains = Gains.load(str(tmp_path))
    assert gains.specification("linear", "icr_radius") == "linear:stiffness=40.0"
    assert gains.specification("linear", "exponential") == "linear:stiffness=40.0"
    assert gains.specification("linear", "online_cold") == "linear:stiffness=60.0,damping=1.0"
    assert gains.specification("linear:stiffness=160", "online") == "linear:stiffness=160"
    assert gains.choice("linear", "online_cold").gains == f"{tmp_path} for online"
    assert gains.choice("linear:stiffness=160", "online").gains == "given"
    assert (
        gains.choice("my:Mine", "online")
        == Gains.load("default").choice("lqr", "online")
        == ("default", {})
    )
    # which is not in the folder
    assert gains.choice("lqr", "online") == Gains.load("tuned").choice("lqr", "online")


def test_shipped_gains_are_those_of_controllers_that_take_them():
    gains = Gains.load("tuned")
    for (name, compensation), arguments in gains.tables["tuned"].items():
        assert set(arguments) == set(tunable(name)[0])
        controller(gains.specification(name, compensation), RobotParameters().geometry, 0.3, 0.05)


def test_the_search_finds_the_best_gains_that_are_smooth_enough():
    """A made-up error with its minimum at 0.9 and 40, and a roughness that forbids a stiffness
    above 30.
    """

    def drive(generation):
        assert len(generation) == 12
        rows = []
        for gains in generation.values():
            position = (
                0.01 + np.log(gains["damping"] / 0.9) ** 2 + np.log(gains["stiffness"] / 40) ** 2
            )
            rows.append(
                {
                    "error": None,
                    "gains": gains,
                    "position": position,
                    "roughness": gains["stiffness"] / 15,
                }
            )
        return rows

    config = Config(evaluations=600, roughness=2.0)
    row = tune.Search(config, ClosedLoops(config, "drawn"), "linear", "none").best(drive)
    assert row["arguments"]["damping"] == pytest.approx(0.9, rel=0.05)
    assert 28 < row["arguments"]["stiffness"] <= 30
    assert row["roughness"] <= 2.0
    assert row["default_error"] == pytest.approx(
        0.01 + np.log(0.7 / 0.9) ** 2 + np.log(10 / 40) ** 2
    )


def test_a_search_without_a_candidate_that_drives_says_why(refused, short, tmp_path, monkeypatch):
    monkeypatch.setattr(tune, "TRAINING_PATHS", (str(tmp_path / "bend.csv"),))
    monkeypatch.setattr("sys.dont_write_bytecode", True)  # a refused command leaves nothing
    Path("never_drives.py").write_text(NEVER)
    line = refused("tune", "never_drives:Never", *QUICK, "--evaluations", "12")
    assert line.startswith("never_drives:Never with none: no gains drive all training runs: run ")
    assert "does not work yet" in line


@pytest.mark.slow
def test_tuning_and_driving_with_the_gains(trackslip, short, tmp_path, monkeypatch):
    monkeypatch.setattr(tune, "TRAINING_PATHS", (str(tmp_path / "bend.csv"),))
    tuned = trackslip("tune", "linear", *QUICK, "--evaluations", "12")
    (row,) = tuned.summary["gains"]
    assert row["error"] < row["default_error"]
    assert "linear" in tuned.printed
    options = (
        "--controllers",
        "linear",
        "--gains",
        str(tuned.folder),
        "--references",
        str(tmp_path / "bend.csv"),
    )
    options += (
        "--localization",
        "truth",
        "--compensations",
        "none",
        "--seeds",
        "100",
        "--jobs",
        "1",
    )
    driven = trackslip("benchmark", *options)
    (entry,) = driven.summary["board"]
    assert entry["score"] == pytest.approx(row["error"], rel=1e-9)
