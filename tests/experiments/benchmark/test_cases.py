"""The runs of a benchmark: names, fleets, starts, and noise that are the same in any company."""

import numpy as np
import pytest

from experiments.benchmark.cases import Case, cases_of, identified
from experiments.benchmark.drive import ClosedLoops
from experiments.commands.benchmark import Config
from experiments.options.choices import CONTROLLER_NAMES, REFERENCE_NAMES
from experiments.sweep.engine import fleets
from sim.stopwatch import Stopwatch
from trackslip.controllers.named import CONTROLLERS
from trackslip.trajectory.named import REFERENCES


def test_suites_know_all_names():
    assert tuple(CONTROLLERS) == CONTROLLER_NAMES
    assert tuple(REFERENCES) == REFERENCE_NAMES


@pytest.mark.parametrize(("suite", "runs"), [("paper", 75), ("quick", 60), ("full", 2160)])
def test_fleets_are_of_one_reference_and_no_larger_than_worthwhile(suite, runs):
    cases, _ = cases_of(Config(suite=suite))
    groups = fleets(cases, 2, ClosedLoops.sizes)
    assert len({case for group in groups for case in group}) == sum(map(len, groups)) == len(cases) == runs
    for group in groups:
        assert len({case.reference for case in group}) == 1
        assert len(group) <= 32


def test_a_run_is_the_same_in_any_company(tmp_path):
    """Bit for bit, whichever controllers, compensations and grounds share its fleet."""
    path = tmp_path / "bow.csv"
    path.write_text("x,y\n-2,1\n-1.6,1.1\n-1.2,1.4\n")
    loops = ClosedLoops(Config())
    cases = [
        Case(controller, compensation, str(path), ground, "random", seed)
        for controller in ("linear", "feedforward")
        for compensation in ("online", "icr_radius")
        for ground, seed in (("stone", 0), ("ice", 1))
    ]
    logs = {log.run: log for log in loops.drive(cases, Stopwatch(), None)}
    for case in (cases[0], cases[5]):
        (alone,) = loops.drive([case], Stopwatch(), None)
        np.testing.assert_array_equal(alone.truth.pose, logs[case.name].truth.pose)
        np.testing.assert_array_equal(alone.pose, logs[case.name].pose)
        np.testing.assert_array_equal(alone.command, logs[case.name].command)


def test_starts_are_the_papers_or_random_and_the_same_for_all_controllers():
    case = Case("linear", "none", "paper", "stone", "paper", 0)
    np.testing.assert_allclose(case.start_pose(), [0.3, -0.2, np.pi / 3], atol=1e-12)
    starts = [Case(c, "none", "paper", "stone", "random", n).start_pose() for c in ("linear", "lqr") for n in (0, 1)]
    np.testing.assert_array_equal(starts[:2], starts[2:])
    assert np.hypot(*(starts[0] - starts[1])[:2]) > 0.01


def test_noise_is_the_same_for_all_controllers(tmp_path):
    path = tmp_path / "bow.csv"
    path.write_text("x,y\n-2,1\n-1.6,1.1\n-1.2,1.4\n")
    loops = ClosedLoops(Config())
    cases = [Case("feedforward", c, str(path), "stone", "zero", 0) for c in ("none", "icr_radius")]
    logs = loops.drive(cases, Stopwatch(), None)
    np.testing.assert_array_equal(logs[0].pose[0], logs[1].pose[0])
    assert np.any(logs[0].pose[0] != logs[0].truth.pose[0])


def test_parts_depend_on_what_a_users_modules_say(tmp_path, short, monkeypatch):
    (tmp_path / "gains_of_mine.py").write_text("K = 1.0")
    source = "import gains_of_mine\nfrom trackslip.controllers.linear import LinearTimeVarying as Mine"
    (tmp_path / "imports_gains.py").write_text(source)
    loops = ClosedLoops(Config(localization="truth"))
    cases = (Case("imports_gains:Mine", "none", "bend.csv", "stone", "zero", 0),)
    loops.check(cases)
    before = identified(cases, loops.config, loops.world)
    (tmp_path / "gains_of_mine.py").write_text("K = 2.0")
    assert identified(cases, loops.config, loops.world) != before
