"""Means over seeds, the leaderboard and its intervals, and the answer."""

import numpy as np
import pytest

from experiments.benchmark.cases import BenchmarkCase
from experiments.benchmark.page import answer
from experiments.benchmark.rows import board, over_seeds


def run(controller, rms, success=True, error=None, seed=0, compensation="online"):
    axes = BenchmarkCase(controller, compensation, "paper", "stone", "zero", seed).axes
    if error:
        return axes | {"error": error}
    return axes | {"error": None, "rms_position": rms, "rms_position_after_12s": rms, "success": success}


def test_means_are_over_the_seeds_that_ran():
    (row,) = over_seeds([run("a", 1.0), run("a", 3.0, seed=1), run("a", 0.0, error="no", seed=2)])
    assert row["rms_position"] == 2.0
    assert (row["seeds"], row["failed"]) == (3, 1)
    assert row["success"] == pytest.approx(2 / 3)
    assert row["final_position"] is None


def test_who_keeps_the_path_stands_above_who_is_near_it():
    runs = [run("near", 0.001, success=False), run("kept", 0.1), run("better", 0.05), run("failed", 0, error="no")]
    entries = board(runs)
    assert [entry["controller"] for entry in entries] == ["better", "kept", "near", "failed"]
    assert "2 of 4 entries lose the path in some runs" in answer(entries, "next", {}, 0.05).warnings


def test_entries_are_compared_pair_by_pair():
    """Plants differ far more than the second entry from the first; the third can't be told from the second."""
    rng = np.random.default_rng(0)
    plant = rng.uniform(0.001, 0.1, 32)
    errors = {"first": plant, "second": plant + 0.001, "third": plant + 0.001 + 3e-5 * rng.normal(size=32)}
    runs = [run(name, rms, seed=k) for name, values in errors.items() for k, rms in enumerate(values)]
    first, *others = board(runs)
    assert (first["controller"], first["rank"], first["behind"], first["behind_ci95"]) == ("first", 1, 0.0, None)
    assert [entry["rank"] for entry in others] == [2, 2]
    for entry in others:
        low, high = entry["behind_ci95"]
        assert 0.0009 < low <= entry["behind"] <= high < 0.0011


@pytest.mark.slow
@pytest.mark.parametrize(("paths", "grounds", "seeds"), [(1, 1, 32), (4, 1, 8), (8, 3, 3)])
def test_intervals_of_paired_differences_and_gains_cover_as_they_should(paths, grounds, seeds):
    """Of a benchmark's suites; on the grounds of a seed the differences are nearly the same."""
    rng = np.random.default_rng(1)
    covered, gains = [], []
    for _ in range(400):
        shape = paths, grounds, seeds
        plant, differs = rng.exponential(0.01, shape), 0.002 + rng.normal(0, 0.002, (paths, 1, seeds))
        errors = {"online": plant, "none": plant + differs + rng.normal(0, 0.0002, shape)}
        runs = [
            run("linear", 0.1 + rms, seed=seed, compensation=name) | {"reference": f"{path}", "ground": f"{ground}"}
            for name, values in errors.items()
            for (path, ground, seed), rms in np.ndenumerate(values)
        ]
        entries = {entry["compensation"]: entry for entry in board(runs)}
        low, high = entries["none"]["behind_ci95"]
        covered.append(low < 0.002 < high)
        low, high = entries["online"]["gain_ci95"]
        gains.append(low < 0.112 / 0.11 < high)
        assert entries["none"]["gain"] is None
    assert 0.90 < np.mean(covered) < 0.99
    assert 0.90 < np.mean(gains) < 0.99


def test_the_answer_names_the_best_its_gain_and_its_rivals():
    errors = {("linear", "online"): 0.002, ("linear", "none"): 0.005, ("lqr", "online"): 0.003}
    runs = [
        run(controller, rms + 1e-5 * seed, seed=seed, compensation=law)
        for (controller, law), rms in errors.items()
        for seed in range(3)
    ]
    found = answer(board(runs), "trackslip track", {"linear": 0.049, "lqr": 0.061}, 0.05)
    assert found.heading == "Best: linear with online, 2.0 mm (95 %: 2.0 to 2.0) from the path"
    assert found.lines == [
        "Slip compensation divides its error by 2.5 (95 %: 2.5 to 2.5); without, it is 5.0 mm.",
        "Next: lqr with online, 1.0 mm (95 %: 1.0 to 1.0) behind.",
    ]
    slow = "lqr takes 61 ms a step for one robot, but commands are due every 50 ms"
    assert (found.warnings, found.next) == ([slow], ["trackslip track"])


def test_a_single_plant_tells_no_interval():
    entries = first, second = board([run("a", 0.001), run("b", 0.002)])
    assert (first["rank"], second["rank"], second["behind_ci95"]) == (1, 2, None)
    assert (
        "there are no intervals with one seed: ranks are the order of the errors"
        in answer(entries, "", {}, 0.05).warnings
    )
