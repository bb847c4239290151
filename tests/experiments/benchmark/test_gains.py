"""Tuned gains: files, which compensation takes which, and the search."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from experiments.benchmark import tuning
from experiments.benchmark.cases import BenchmarkCase
from experiments.benchmark.drive import ClosedLoops
from experiments.benchmark.gains import SHIPPED, Gains
from experiments.benchmark.tuning import Tried, tune
from experiments.cli import main
from experiments.common.lookup import controller, tunable
from experiments.simulate.options import DriveOptions
from experiments.studies.trials import FILE, Trial
from experiments.tune import Config
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


@pytest.mark.parametrize(
    "content", ["", "[]", "[" * 100_000, '{"gains": [{}]}', '{"gains": [{"controller": 1, "arguments": 2}]}']
)
def test_other_files_are_refused(tmp_path, content):
    (tmp_path / "gains.json").write_text(content)
    with pytest.raises(InvalidValueError, match="must be tuned, default, or a folder or file that trackslip tune"):
        Gains.load(str(tmp_path))


@pytest.mark.parametrize(("name", "value"), [("stiffness", -1.0), ("stiffness", float("nan")), ("weight", 1.0)])
def test_gains_that_a_controller_refuses_are_refused_before_driving(refused, tmp_path, name, value):
    row = {"controller": "linear", "compensation": "none", "arguments": {name: value}}
    (tmp_path / "gains.json").write_text(json.dumps({"gains": [row]}))
    assert name in refused("benchmark", "--controllers", "linear", "--compensations", "none", "--gains", "gains.json")


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"radius_error": 0.49}, "radius_error"),
        ({"drive": DriveOptions(lag=0.001)}, "lag"),
        ({"robot": "nose_heavy.toml"}, "com_x"),
    ],
)
def test_robots_whose_plants_would_exceed_limits_are_refused(tmp_path, monkeypatch, options, field):
    monkeypatch.chdir(tmp_path)
    Path("nose_heavy.toml").write_text("com_x = 0.05\n")
    case = BenchmarkCase("linear", "none", "circle", "stone", "random", 0)
    ClosedLoops(Config(**options)).check([case])
    with pytest.raises(InvalidValueError, match=f"{field} of drawn plants = "):
        ClosedLoops(Config(**options), "drawn").check([case])


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


CLASSES = """
from trackslip.controllers.error_feedback import Kanayama
class Good(Kanayama):
    def __init__(self, across={across}): super().__init__(across=across)
class Other(Good):
    def twist(self, time, pose, reference):
        assert {works}, "does not work yet"
        return super().twist(time, pose, reference)
"""


def test_a_search_resumes_unless_the_controllers_have_changed(trackslip, short, tmp_path, monkeypatch):
    monkeypatch.setattr(tuning, "TRAINING_PATHS", (str(tmp_path / "bend.csv"),))
    options = ("--compensations", "none", "--evaluations", "12", "--localization", "truth", "--threads", "1")
    command = ("tune", "tuned_classes:Good", "tuned_classes:Other", *options, "--out", "found")

    def write(**filled):
        sys.modules.pop("tuned_classes", None)
        Path("tuned_classes.py").write_text(CLASSES.format(**filled))

    write(across=15.0, works=False)
    Path("found").mkdir()
    with pytest.raises(SystemExit):
        main(list(command))
    assert (Path("found") / FILE).exists()
    write(across=150.0, works=True)
    good, other = trackslip(*command).summary["gains"]
    assert good["default_error"] == other["default_error"]


def test_a_search_without_a_candidate_that_drives_says_why(refused, short, tmp_path, monkeypatch):
    monkeypatch.setattr(tuning, "TRAINING_PATHS", (str(tmp_path / "bend.csv"),))
    monkeypatch.setattr("sys.dont_write_bytecode", True)  # a refused command leaves nothing
    Path("never_drives.py").write_text(CLASSES.format(across=15.0, works=False))
    options = ("--compensations", "none", "--evaluations", "12", "--localization", "truth", "--threads", "1")
    said = refused("tune", "never_drives:Other", *options)
    assert said.startswith("never_drives:Other with none: no gains drive all training runs: run ")
    assert "does not work yet" in said
    Path("never_drives.py").write_text("class Never:\n    def __init__(self, gain=1.0): raise RuntimeError('no')")
    sys.modules.pop("never_drives")
    assert "(RuntimeError: no)" in refused("tune", "never_drives:Never", *options)


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
