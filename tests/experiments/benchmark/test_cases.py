"""Benchmarks: runs independent of their fleet, means over seeds, and the leaderboard."""

import re

import numpy as np
import pytest

from experiments.benchmark.cases import BenchmarkCase, cases_of, identified
from experiments.benchmark.config import Config
from experiments.benchmark.drive import ClosedLoops
from experiments.benchmark.gains import Gains
from experiments.benchmark.rows import board, bootstrap95, losses, over_seeds
from experiments.benchmark.submission import submission
from experiments.cli import main
from experiments.common.choices import CONTROLLER_NAMES, GROUND_NAMES, REFERENCE_NAMES
from experiments.common.sweep import fleets
from sim.ground.named import NAMED_GROUNDS, load_ground
from sim.stopwatch import Stopwatch
from trackslip.controllers.named import CONTROLLERS
from trackslip.trajectory.named import REFERENCES


def test_suites_know_all_names():
    assert tuple(CONTROLLERS) == CONTROLLER_NAMES
    assert tuple(REFERENCES) == REFERENCE_NAMES
    assert tuple(NAMED_GROUNDS) == GROUND_NAMES


@pytest.mark.parametrize(("suite", "runs"), [("paper", 75), ("fair", 1344), ("full", 3024)])
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
    before = identified(cases, loops)
    (tmp_path / "gains_of_mine.py").write_text("K = 2.0")
    assert identified(cases, loops) != before


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
    assert [entry["controller"] for entry in board(runs)] == ["better", "kept", "near", "failed"]
    lines = losses(rows)
    assert lines[0] == "near with none on stone loses the path in 1 of 1 runs: paper"
    assert lines[1] == "failed with none on stone loses the path in 1 of 1 runs, 1 of them failed: paper"
    assert lines[2:] == ["all others keep the path in every run"]


def test_entries_are_compared_pair_by_pair():
    """Plants differ far more than the second entry from the first; the third can't be told from the second."""
    rng = np.random.default_rng(0)
    plant = rng.uniform(0.001, 0.1, 32)
    errors = {"first": plant, "second": plant + 0.001, "third": plant + 0.001 + 3e-5 * rng.normal(size=32)}
    runs = [run(name, rms, seed=k) for name, every in errors.items() for k, rms in enumerate(every)]
    first, *others = board(runs)
    assert (first["controller"], first["rank"], first["behind"], first["behind_ci95"]) == ("first", 1, 0.0, None)
    assert [entry["rank"] for entry in others] == [2, 2]
    for entry in others:
        low, high = entry["behind_ci95"]
        assert 0.0009 < low <= entry["behind"] <= high < 0.0011


@pytest.mark.parametrize(("paths", "grounds", "seeds"), [(1, 1, 32), (4, 1, 8), (8, 3, 3)])
def test_intervals_of_paired_differences_cover_as_they_should(paths, grounds, seeds):
    """Of a benchmark's suites; on the grounds of a seed the differences are nearly the same."""
    rng = np.random.default_rng(1)
    covered = []
    for _ in range(400):
        shape = paths, grounds, seeds
        plant, differs = rng.exponential(0.01, shape), 0.002 + rng.normal(0, 0.002, (paths, 1, seeds))
        errors = {"best": plant, "other": plant + differs + rng.normal(0, 0.0002, shape)}
        runs = [
            run(name, 0.1 + rms, seed=seed) | {"reference": f"path {path}", "ground": f"ground {ground}"}
            for name, every in errors.items()
            for (path, ground, seed), rms in np.ndenumerate(every)
        ]
        low, high = next(entry["behind_ci95"] for entry in board(runs) if entry["controller"] == "other")
        covered.append(low < 0.002 < high)
    assert 0.90 < np.mean(covered) < 0.99


def test_a_submission_has_the_scores_of_all_runs_and_how_to_drive_them_again():
    runs = [run("linear", rms, success=rms < 0.1, seed=seed) for seed, rms in enumerate((0.002, 0.2))]
    gains = Gains({"linear": {"none": {"stiffness": 40.0}}})
    about = {"config": {"suite": "fair"}, "git": {"commit": "c0ffee"}, "versions": {"mujoco": "4.0.0"}}
    found = submission(runs, board(runs), gains, about)
    (row,) = found.pop("rows")
    assert found == {"suite": "fair", "git": {"commit": "c0ffee"}, "versions": {"mujoco": "4.0.0"}}
    assert (row["specification"], row["compensation"]) == ("linear:stiffness=40.0", "none")
    assert row["runs"] == {"paper": {"0": 0.002, "1": 0.5}}
    assert row["score"] == pytest.approx(0.251)


def test_a_single_plant_tells_no_interval():
    first, second = board([run("a", 0.001), run("b", 0.002)])
    assert (first["rank"], second["rank"], second["behind_ci95"]) == (1, 2, None)


def test_plants_are_drawn_around_the_nominal_one_and_are_the_same_for_all_controllers():
    loops = ClosedLoops(Config(), "drawn")
    plants = [loops.plant(BenchmarkCase("linear", "none", "circle", "stone", "zero", seed)) for seed in range(200)]
    assert plants[3] == loops.plant(BenchmarkCase("lqr", "online", "circle", "stone", "random", 3))
    assert plants[3] != loops.plant(BenchmarkCase("linear", "none", "slalom", "stone", "zero", 3))
    drawn = np.array(
        [
            [
                plant.setting.ground.across / load_ground("stone").across,
                plant.setting.radius_error - loops.world.radius_error,
                plant.setting.lag / loops.world.drive.lag,
                *plant.setting.weight,
                plant.scanner_noise / loops.config.scanner.noise,
                len(plant.setting.ground.patches),
            ]
            for plant in plants
        ]
    )
    low, high = np.array([[0.8, -0.03, 0.5, -0.0168, -0.0168, 0.5, 0], [1.25, 0.03, 2.0, 0.0168, 0.0168, 2.0, 2]])
    assert np.all((drawn >= low) & (drawn <= high))
    np.testing.assert_allclose(drawn.mean(axis=0), (low + high) / 2, atol=0.1 * (high - low).max())
    correlation = np.corrcoef(drawn.T) - np.eye(len(low))
    assert np.abs(correlation).max() < 0.3


def test_a_plant_drives_as_its_radius_error_says(tmp_path):
    """On the straight start of a path, without feedback: v of the drawn radius."""
    path = tmp_path / "straight.csv"
    path.write_text("x,y\n0,0\n0.5,0\n1,0\n")
    loops = ClosedLoops(Config(localization="truth"), "drawn")
    cases = [BenchmarkCase("feedforward", "none", str(path), "stone", "zero", seed) for seed in range(3)]
    for case, log in zip(cases, loops.drive(cases, Stopwatch(), None), strict=True):
        error = loops.plant(case).setting.radius_error
        assert log.metadata["radius_error"] == error
        driven = np.hypot(*(log.truth.pose[-1] - log.truth.pose[0])[:2])
        assert driven == pytest.approx(1 + error, abs=0.006)


@pytest.mark.parametrize(
    ("command", "option"), [("grid", "--grounds"), ("track", "--ground"), ("benchmark", "--grounds")]
)
def test_help_lists_all_grounds(command, option, capsys):
    with pytest.raises(SystemExit):
        main([command, "--help"])
    words = "".join(re.sub(r"[│\s]", "", capsys.readouterr().out))
    assert f"{option}{{{','.join(GROUND_NAMES)}" in words
