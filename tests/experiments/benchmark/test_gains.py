"""Tuned gains: files, which compensation takes which, and the search."""

import json

import numpy as np
import pytest

from experiments.benchmark import tuning
from experiments.benchmark.gains import SHIPPED, Gains
from experiments.benchmark.tuning import Tried, tune
from experiments.commands.tune import Config
from experiments.driving.lookup import controller, tunable
from experiments.studies.trials import Trial
from sim.robot.parameters import RobotParameters
from trackslip.errors import InvalidValueError

ROWS = [
    {"controller": "linear", "compensation": "icr_radius", "arguments": {"stiffness": 40.0}},
    {"controller": "linear", "compensation": "online", "arguments": {"stiffness": 60.0, "damping": 1.0}},
]


@pytest.fixture
def gains(tmp_path):
    (tmp_path / "gains.json").write_text(json.dumps({"gains": ROWS}))
    return Gains.load(str(tmp_path))


@pytest.mark.parametrize(
    ("controller", "compensation", "expected"),
    [
        ("linear", "icr_radius", "linear:stiffness=40.0"),
        ("linear", "exponential", "linear:stiffness=40.0"),
        ("linear", "online_cold", "linear:stiffness=60.0,damping=1.0"),
        ("linear:stiffness=160", "online", "linear:stiffness=160"),
        ("lqr", "online", "lqr"),
    ],
)
def test_a_controller_gets_the_gains_of_its_compensation_or_the_like(gains, controller, compensation, expected):
    assert gains.specification(controller, compensation) == expected


@pytest.mark.parametrize("content", ["", "[]", '{"gains": [{}]}', '{"gains": [{"controller": 1, "arguments": 2}]}'])
def test_other_files_are_refused(tmp_path, content):
    (tmp_path / "gains.json").write_text(content)
    with pytest.raises(InvalidValueError, match="must be tuned, default, or a folder or file that trackslip tune"):
        Gains.load(str(tmp_path))


def test_shipped_gains_are_those_of_controllers_that_take_them():
    geometry = RobotParameters().geometry
    rows = json.loads(SHIPPED.read_text(encoding="utf-8"))["gains"]
    for row in rows:
        assert set(row["arguments"]) == set(tunable(row["controller"]))
        controller(Gains.load("tuned").specification(row["controller"], row["compensation"]), geometry, 0.3, 0.05)


def test_the_search_finds_the_best_gains_within_the_limit_on_roughness(monkeypatch):
    """A made-up error with its minimum at 0.9 and 40, and a roughness that forbids a stiffness above 30."""

    def tried(self, specifications):
        made = [controller(one, RobotParameters().geometry, 0.3, 0.05) for one in specifications]
        return [
            Tried(0.01 + np.log(c.damping / 0.9) ** 2 + np.log(c.stiffness / 40) ** 2, c.stiffness / 15) for c in made
        ]

    monkeypatch.setattr(tuning.Training, "tried", tried)
    trial, config = Trial("linear none", given=("linear", "none")), Config(evaluations=600, roughness=2.0)
    found = tune(trial, np.random.default_rng(0), config).numbers
    assert found["arguments"]["damping"] == pytest.approx(0.9, rel=0.05)
    assert 28 < found["arguments"]["stiffness"] <= 30
    assert found["roughness"] <= 2.0
    assert found["default_error"] == pytest.approx(0.01 + np.log(0.7 / 0.9) ** 2 + np.log(10 / 40) ** 2)


def test_rougher_is_worse_than_any_error():
    costs = [Tried(error, rough).cost(2.0) for error, rough in ((0.001, 1.9), (0.5, 2.0), (0.001, 2.1), (0.001, 3.0))]
    assert costs == sorted(costs)
    assert costs[0] == 0.001


def test_tuning_and_driving_with_what_was_found(trackslip, tmp_path, monkeypatch):
    monkeypatch.setattr(tuning, "TRAINING_PATHS", (str(tmp_path / "bend.csv"),))
    (tmp_path / "bend.csv").write_text("x,y\n0,0\n0.3,0.05\n0.6,0.2\n")
    options = ("--evaluations", "24", "--localization", "truth", "--threads", "1", "--compensations", "none")
    tuned = trackslip("tune", "linear", *options)
    (row,) = tuned.summary["gains"]
    assert row["error"] < row["default_error"]
    assert "linear" in tuned.printed
    options = ("--references", str(tmp_path / "bend.csv"), "--compensations", "none", "--seeds", "100")
    found = trackslip(
        *("benchmark", "--controllers", "linear", "--gains", str(tuned.folder), "--localization", "truth"),
        *options,
        "--jobs",
        "1",
    )
    (entry,) = found.summary["board"]
    assert entry["score"] == pytest.approx(row["error"], rel=1e-9)
