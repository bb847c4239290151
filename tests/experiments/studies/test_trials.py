"""Monte-Carlo studies: repeatable trials, resumption, intervals that cover, and checks that can fail."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from experiments.common.options import ResultsOptions
from experiments.common.run import Run
from experiments.studies.plan_trials import MIN_REPEATS, PAPER, PLAN, plan_study, truth_of
from experiments.studies.trials import (
    FILE,
    Estimate,
    Trial,
    TrialOutcome,
    forget_trials,
    rms_interval,
    run_trials,
    share_interval,
)
from trackslip.kinematics import RobotGeometry
from trackslip.odometry.uncertainty import LawErrors
from trackslip.planning import plan as planning
from trackslip.planning.information import Expectation, PoseQuality
from trackslip.planning.limits import DriveLimits
from trackslip.planning.plan import plan_drive

TRIALS = [Trial(case, number) for case in ("one", "two") for number in range(4)]
KEY = "test {case} {number}"


@dataclass(frozen=True)
class Config(ResultsOptions):
    out: Path
    seed: int = 0
    threads: int = 1
    size: float = 1.0


def normal(trial, rng, size=1.0):
    value = size * float(rng.normal())
    return TrialOutcome(
        {"mean": Estimate(value, size, value - 1.96 * size, np.inf)}, {"number": trial.number}, ("note",)
    )


def outcomes(config, do=normal, trials=TRIALS, about=None):
    with Run(config, partial(forget_trials, config.out)) as run:
        found = run_trials(run, do, trials, KEY, about)
        run.write({})
    return found


class Counted:
    """Counts trials, and interrupts before number `stop`."""

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


@pytest.mark.parametrize("old", [b"1", b"{", b"e", b"]", b"0.", b"\n"])
@pytest.mark.parametrize("new", [b"", b"\xff", b"[", b"2", b"null"])
def test_damaged_trials_are_done_again(killed, tmp_path, old, new):
    file = tmp_path / FILE
    title, _, trials = file.read_bytes().partition(b"\n")
    file.write_bytes(title + b"\n" + trials.replace(old, new, 1))
    count = Counted()
    assert outcomes(killed, count) == outcomes(Config(tmp_path / "other"))
    assert len(count.done) in (6, 7)  # a line, or two that have become one


@pytest.mark.parametrize("change", [{"seed": 1}, {"size": 2.0}, {"about": "another ground"}])
def test_other_options_start_again(killed, change):
    count = Counted()
    outcomes(replace(killed, **{k: v for k, v in change.items() if k != "about"}), count, about=change.get("about"))
    assert len(count.done) == 8


def test_intervals_of_shares_cover():
    """Clopper-Pearson intervals have at least their nominal coverage for any probability."""
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


PREDICTED = {"offset": 2e-4, "radius_error": 6e-4}
TRUTH = np.array([0.045, 0.0066])


@pytest.fixture(scope="module")
def plan():
    """A plan for a robot of twice the gauge, with expected errors PREDICTED."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planning, "_EVALUATIONS", 30)
        patch.setattr(planning, "_FEWEST", 30)
        limits, poses = DriveLimits(0.3, 0.5, (4.0, 4.0), 120.0), PoseQuality(10.0, 0.02, 0.017)
        found = plan_drive(RobotGeometry(0.336, 0.06), limits, poses, values=[0.08, 0.01])
    return replace(found, expectation=Expectation(PREDICTED, ()))


def trials(plan, size=1.0, paper=1.0, reach=0.9, speed=1.0):
    """Estimates with errors of `size` times those predicted; the paper's runs are expected to have `paper` times."""
    errors = size * np.array([*PREDICTED.values()]) * np.random.default_rng(0).standard_normal((4 * MIN_REPEATS, 2))
    outcomes = []
    for values in (TRUTH + errors).tolist():
        known = {name: Estimate(one, PREDICTED[name], 0.0, 1.0) for name, one in zip(PREDICTED, values, strict=True)}
        outcomes.append(TrialOutcome(known, {"reach": reach, "speed": speed}))
    expected = Expectation({name: paper * value for name, value in PREDICTED.items()}, ())
    truth = dict(zip(PREDICTED, TRUTH.tolist(), strict=True))
    return plan_study(plan, expected, truth, MIN_REPEATS, {PLAN: outcomes, PAPER: outcomes[:MIN_REPEATS]})


def broken(found):
    return {check.what.split(" of ")[0].split(",")[0] for check in found.checks if not check.holds}


def test_honest_trials_hold(plan):
    found = trials(plan, paper=1.2)
    assert broken(found) == set()
    assert len(found.checks) == 3 + 2 + 2
    assert found.summary["uncertainty_of_real"][PLAN] == pytest.approx(1 / np.sqrt(2 * 400))
    for case in (PLAN, PAPER):
        for name, (low, high) in found.summary["interval95_of_real"][case].items():
            assert low < PREDICTED[name] < high


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"size": 1.5}, {"real over predicted error", "error"}),
        ({"size": 0.5, "paper": 1.0}, {"real over predicted error"}),
        ({"paper": 0.5}, {"error"}),
        ({"reach": 1.01}, {"farthest from the middle"}),
        ({"speed": 1.01}, {"largest speed"}),
    ],
)
def test_dishonest_ones_do_not(plan, change, what):
    assert broken(trials(plan, **{"paper": 1.2} | change)) == what


def test_without_knowledge_the_truth_is_the_shipped_robot_s_to_scale(plan):
    np.testing.assert_allclose(truth_of(plan, np.random.default_rng(0)), [0.09, 0.0066])


def test_after_an_identification_it_is_drawn_from_its_uncertainty(plan):
    covariance = np.array([[4e-6, 1e-6], [1e-6, 1e-6]])
    known = replace(plan, known=LawErrors(("offset", "radius_error"), covariance))
    drawn = np.array([truth_of(known, np.random.default_rng(seed)) for seed in range(2000)])
    np.testing.assert_allclose(drawn.mean(axis=0), [0.08, 0.01], atol=2e-4)
    np.testing.assert_allclose(np.cov(drawn.T), covariance, rtol=0.15)
