"""Benchmarks: runs independent of their fleet, means over seeds, and the leaderboard."""

import re

import numpy as np
import pytest

from experiments.benchmark.cases import BenchmarkCase, cases_of, identified
from experiments.benchmark.drive import ClosedLoops
from experiments.benchmark.rows import board, bootstrap95, losses, over_seeds
from experiments.cli import main
from experiments.commands.benchmark import Config
from experiments.options.choices import CONTROLLER_NAMES, GROUND_NAMES, REFERENCE_NAMES
from experiments.sweep.engine import fleets
from sim.ground.named import NAMED_GROUNDS
from sim.stopwatch import Stopwatch
from trackslip.controllers.named import CONTROLLERS
from trackslip.trajectory.named import REFERENCES


def test_suites_know_all_names():
    assert tuple(CONTROLLERS) == CONTROLLER_NAMES
    assert tuple(REFERENCES) == REFERENCE_NAMES
    assert tuple(NAMED_GROUNDS) == GROUND_NAMES


@pytest.mark.parametrize(("suite", "runs"), [("paper", 75), ("quick", 60), ("full", 2160)])
def test_fleets_are_of_one_reference_and_no_larger_than_worthwhile(suite, runs):
    cases, _ = cases_of(Config(suite=suite))
    groups = fleets(cases, 2, ClosedLoops.sizes)
    assert len({case for group in groups for case in group}) == sum(map(len, groups)) == len(cases) == runs
    for group in groups:
        assert len({case.reference for case in group}) == 1
        assert len(group) <= 32


def test_a_run_is_the_same_in_any_company(tmp_path):
    """Whichever controllers, compensations and grounds share its fleet; all controllers meet the same noise."""
    path = tmp_path / "bow.csv"
    path.write_text("x,y\n-2,1\n-1.6,1.1\n-1.2,1.4\n")
    loops = ClosedLoops(Config())
    cases = [
        BenchmarkCase(controller, compensation, str(path), ground, "random", seed)
        for controller in ("linear", "feedforward")
        for compensation in ("online", "icr_radius")
        for ground, seed in (("stone", 0), ("ice", 1))
    ]
    logs = {log.run: log for log in loops.drive(cases, Stopwatch(), None)}
    for case in (cases[0], cases[5]):
        (alone,) = loops.drive([case], Stopwatch(), None)
        np.testing.assert_array_equal(alone.truth.pose, logs[case.name].truth.pose)
        np.testing.assert_array_equal(alone.pose, logs[case.name].pose)
    linear, feedforward = (logs[case.name].pose[0] for case in (cases[0], cases[4]))
    np.testing.assert_array_equal(linear, feedforward)
    assert np.any(linear != logs[cases[0].name].truth.pose[0])


def test_starts_are_the_papers_or_random_and_the_same_for_all_controllers():
    case = BenchmarkCase("linear", "none", "paper", "stone", "paper", 0)
    np.testing.assert_allclose(case.start_pose(), [0.3, -0.2, np.pi / 3], atol=1e-12)
    starts = [
        BenchmarkCase(c, "none", "paper", "stone", "random", n).start_pose() for c in ("linear", "lqr") for n in (0, 1)
    ]
    np.testing.assert_array_equal(starts[:2], starts[2:])
    assert np.hypot(*(starts[0] - starts[1])[:2]) > 0.01


def test_parts_depend_on_what_a_users_modules_say(tmp_path, short, monkeypatch):
    (tmp_path / "gains_of_mine.py").write_text("K = 1.0")
    source = "import gains_of_mine\nfrom trackslip.controllers.error_feedback import LinearTimeVarying as Mine"
    (tmp_path / "imports_gains.py").write_text(source)
    loops = ClosedLoops(Config(localization="truth"))
    cases = (BenchmarkCase("imports_gains:Mine", "none", "bend.csv", "stone", "zero", 0),)
    loops.check(cases)
    before = identified(cases, loops.config, loops.world)
    (tmp_path / "gains_of_mine.py").write_text("K = 2.0")
    assert identified(cases, loops.config, loops.world) != before


def run(controller, rms, success=True, error=None, seed=0):
    axes = BenchmarkCase(controller, "none", "paper", "stone", "zero", seed).axes
    if error:
        return axes | {"error": error}
    return axes | {"error": None, "rms_position": rms, "rms_position_after_12s": rms, "success": success}


def test_means_and_intervals_are_over_the_seeds_that_ran():
    (row,) = over_seeds([run("a", 1.0), run("a", 3.0, seed=1), run("a", 0.0, error="no", seed=2)])
    assert row["rms_position"] == 2.0
    assert row["rms_position_ci95"] == (1.0, 3.0)
    assert (row["seeds"], row["failed"]) == (3, 1)
    assert row["success"] == pytest.approx(2 / 3)
    assert row["final_position"] is None


def test_bootstrap_of_the_mean_covers_as_it_should():
    rng = np.random.default_rng(0)
    intervals = [bootstrap95(rng.normal(size=40).tolist()) for _ in range(400)]
    covered = np.mean([low < 0 < high for low, high in intervals])
    assert 0.90 < covered < 0.98


def test_who_keeps_the_path_stands_above_who_is_near_it():
    runs = [run("near", 0.001, success=False), run("kept", 0.1), run("better", 0.05), run("failed", 0, error="no")]
    rows = over_seeds(runs)
    assert [entry["controller"] for entry in board(rows)] == ["better", "kept", "near", "failed"]
    lines = losses(rows)
    assert lines[0] == "near with none on stone loses the path in 1 of 1 runs: paper"
    assert lines[1] == "failed with none on stone loses the path in 1 of 1 runs, 1 of them failed: paper"
    assert lines[2:] == ["all others keep the path in every run"]


@pytest.mark.parametrize(
    ("command", "option"), [("grid", "--grounds"), ("track", "--ground"), ("benchmark", "--grounds")]
)
def test_help_lists_all_grounds(command, option, capsys):
    with pytest.raises(SystemExit):
        main([command, "--help"])
    words = "".join(re.sub(r"[│\s]", "", capsys.readouterr().out))
    assert f"{option}{{{','.join(GROUND_NAMES)}" in words
