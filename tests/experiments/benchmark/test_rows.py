"""Means over seeds, and the leaderboard made of them."""

import numpy as np
import pytest

from experiments.benchmark.cases import Case
from experiments.benchmark.rows import board, bootstrap95, losses, over_seeds


def run(controller, rms, success=True, error=None, seed=0):
    axes = Case(controller, "none", "paper", "stone", "zero", seed).axes
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
