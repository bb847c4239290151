"""The engine of studies: trials are the same for any number of processes, a killed study resumes, intervals cover."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from experiments.run import Run
from experiments.studies.trials import (
    FILE,
    Estimate,
    Outcome,
    Trial,
    forget_trials,
    rms_interval,
    run_trials,
    share_interval,
)

TRIALS = [Trial(case, number) for case in ("one", "two") for number in range(4)]
KEY = "test {case} {number}"


@dataclass(frozen=True)
class Config:
    out: Path
    seed: int = 0
    threads: int = 1
    size: float = 1.0


def normal(trial, rng, size=1.0):
    value = size * float(rng.normal())
    return Outcome({"mean": Estimate(value, size, value - 1.96 * size, np.inf)}, {"number": trial.number}, ("note",))


def outcomes(config, do=normal, trials=TRIALS, about=None):
    with Run(config, partial(forget_trials, config.out)) as run:
        found = run_trials(run, do, trials, KEY, about)
        run.write({})
    return found


class Counted:
    """Trials in this process, interrupted before one of them."""

    def __init__(self, stop=None):
        self.done, self.stop = [], stop

    def __call__(self, trial, rng):
        if len(self.done) == self.stop:
            raise KeyboardInterrupt
        self.done.append(trial)
        return normal(trial, rng)


@pytest.fixture
def killed(tmp_path):
    """A study that was interrupted after three trials."""
    with pytest.raises(KeyboardInterrupt, match="interrupted with 3 of 8 trials done; the same command resumes"):
        outcomes(Config(tmp_path), Counted(stop=3))
    return Config(tmp_path)


def test_any_number_of_processes_gives_the_same(tmp_path):
    one, two = (outcomes(Config(tmp_path / str(threads), threads=threads)) for threads in (1, 2))
    assert one == two
    assert list(one) == ["one", "two"]
    assert [outcome.numbers["number"] for outcome in one["two"]] == [0, 1, 2, 3]


def test_random_numbers_depend_on_the_trial_not_on_its_place(tmp_path):
    few = outcomes(Config(tmp_path / "few"), trials=TRIALS[::-2])
    every = outcomes(Config(tmp_path / "all"))
    assert few["two"] == every["two"][3::-2]
    values = {outcome.estimates["mean"].value for ones in every.values() for outcome in ones}
    assert len(values) == len(TRIALS)
    assert outcomes(Config(tmp_path / "seed", seed=1))["one"] != every["one"]


def test_a_killed_study_resumes(killed, tmp_path):
    count = Counted()
    assert outcomes(killed, count) == outcomes(Config(tmp_path / "other"))
    assert len(count.done) == 5
    assert not (tmp_path / FILE).exists()


@pytest.mark.parametrize("change", [{"seed": 1}, {"size": 2.0}, {"about": "another ground"}])
def test_other_options_start_again(killed, change):
    count = Counted()
    outcomes(replace(killed, **{k: v for k, v in change.items() if k != "about"}), count, about=change.get("about"))
    assert len(count.done) == 8


def test_intervals_of_shares_cover():
    """Clopper and Pearson's cover at least as often as they say, whatever the probability."""
    for share in (0.5, 0.9, 0.95, 0.99):
        drawn = np.random.default_rng(0).binomial(200, share, 2000)
        ends = {k: share_interval(k, 200) for k in set(drawn.tolist())}
        covered = np.mean([ends[k][0] <= share <= ends[k][1] for k in drawn.tolist()])
        assert 0.94 < covered <= 1
    assert share_interval(0, 5)[0] == 0
    assert share_interval(5, 5)[1] == 1


def test_intervals_of_errors_cover():
    rng = np.random.default_rng(0)
    ends = np.array([rms_interval(rng.normal(0, 2.0, 30)) for _ in range(2000)])
    assert np.mean((ends[:, 0] <= 2.0) & (ends[:, 1] >= 2.0)) == pytest.approx(0.95, abs=0.015)
