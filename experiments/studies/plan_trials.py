"""Trials of a planned drive: laws identified from it and from the paper's runs, against truth and prediction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.measuring.check import Check
from experiments.studies.drive_cases import TRUE_LAW
from experiments.studies.planned_drives import (
    OTHER_DURATIONS,
    Driven,
    MujocoDrives,
    driven_by_law,
    driven_in_mujoco,
    paper_by_law,
    prediction_errors,
)
from experiments.studies.trials import Errors, Estimate, Outcome, Results, Trial, Values, run_trials, sampling_error
from sim.drive.drive import Drive
from sim.robot.parameters import RobotParameters
from sim.seeds import generator
from sim.wander.pose_source import SOURCES, PoseSource
from trackslip.errors import TrackslipError
from trackslip.identification.drive.estimate import fit_drives
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.metrics import rms
from trackslip.planning.information import Expectation
from trackslip.planning.plan import DrivePlan, expected_alone, paper_runs, usual_values
from trackslip.planning.strokes import RATE

if TYPE_CHECKING:
    from experiments.commands.plan import Config
    from experiments.run import Run

MIN_REPEATS = 100
"""Minimum repeats before RMS errors are compared with the prediction."""
DRIVES = 4
"""Drives of the plan by the law in a repeat: they take a tenth of the time of the paper's runs."""
PLAN, PAPER = "plan", "paper"
"""The cases: the planned drive, and the paper's runs."""
_KEY = "trial {number} of {case}"
_REACH, _SPEED = "reach", "speed"
_AHEAD = ("position", "heading")
_AGREEMENT = (0.8, 1.2)  # real errors over predicted ones
_AS_GOOD = 120.0  # duration from which on a plan is as good as the paper's runs [s]
_OVER_PAPER = {"offset": 1.0, "radius_error": 1.5}  # largest errors over those of the paper's runs
_MOST = 1 + 1e-6  # of what is allowed, for rounding [-]


@dataclass(frozen=True)
class PlanTrials:
    """All trials of a plan."""

    plan: DrivePlan
    paper: Expectation | None
    """Standard errors to expect of the paper's runs."""
    truth: Values | None
    """Parameters of the law that moves the robot; None in MuJoCo, where repeats measure the same drives again."""
    repeats: int
    outcomes: Mapping[str, list[Outcome]]
    """By case, PLAN or PAPER."""
    log: RunLog
    """The log of the first planned drive."""

    def results(self, case: str) -> Results:
        """The outcomes of PLAN or PAPER, in MuJoCo against their mean, as the truth isn't known."""
        outcomes = self.outcomes.get(case, [])
        return Results(outcomes, [self.truth or self.means(case)] * len(outcomes))

    def means(self, case: str) -> Values:
        """Mean estimates of the parameters, of those that were estimated."""
        found = [one.estimates for one in self.outcomes.get(case, [])]
        values = {name: [one[name].value for one in found if name in one] for name in self.plan.sizes}
        return {name: float(np.mean(some)) for name, some in values.items() if some}

    def errors(self, case: str) -> dict[str, Errors]:
        """Errors of the parameters identified from PLAN or PAPER."""
        results = self.results(case)
        return {name: results.errors(name) for name in self.plan.sizes}

    @property
    def failures(self) -> list[str]:
        """Why fits failed, once each."""
        return [f"{case}: {line}" for case in sorted(self.outcomes) for line in self.results(case).failures]

    @property
    def predicted(self) -> dict[str, Values]:
        """Standard errors expected of each case, without what was known before; empty where nothing is."""
        plan = self.plan.expectation if self.plan.known is None else expected_alone(self.plan)
        return {PLAN: dict(plan.stderr), PAPER: {} if self.paper is None else dict(self.paper.stderr)}

    def ahead(self, case: str) -> tuple[float, ...] | None:
        """RMS errors of other drives predicted by the laws, position [m] and heading [rad]; None if there are none."""
        found = [one.numbers for one in self.results(case).outcomes if _AHEAD[0] in one.numbers]
        return tuple(rms([numbers[name] for numbers in found]) for name in _AHEAD) if found else None

    def checks(self) -> list[Check]:
        """Fits, limits of the drive, and errors over those predicted and those of the paper's runs."""
        case = f"{len(self.outcomes[PLAN])} drives of {self.plan.limits.duration:g} s"
        failed = sum(bool(one.notes) for ones in self.outcomes.values() for one in ones)
        reach, speed = (max(one.numbers[name] for one in self.outcomes[PLAN]) for name in (_REACH, _SPEED))
        rows: list[tuple[str, float, float | tuple[float, float]]] = [
            ("fits that failed", float(failed), 0.0),
            ("farthest from the middle, of what the area allows", reach, _MOST),
            ("largest speed, of what is allowed", speed, _MOST),
        ]
        plan, paper = self.ahead(PLAN), self.ahead(PAPER)
        if plan is not None and paper is not None:
            for what, mine, theirs in zip(_AHEAD, plan, paper, strict=True):
                rows.append(
                    (f"{what} of another drive in 5 s, error over that of the paper's runs", mine / theirs, 1.2)
                )
        if self.truth is not None and self.repeats >= MIN_REPEATS:
            real, predicted, bound = self.errors(PLAN), self.predicted[PLAN], self.predicted[PAPER]
            rows += [
                (f"real over predicted error of {name}", error.rms / predicted[name], _AGREEMENT)
                for name, error in real.items()
                if name in predicted
            ]
            rows += [
                (f"error of {name} over the least that the paper's runs can have", real[name].rms / bound[name], most)
                for name, most in _OVER_PAPER.items()
                if name in real and name in bound and self.plan.limits.duration >= _AS_GOOD
            ]
        return [Check(case, what, value, limit, "1") for what, value, limit in rows]

    def to_json(self) -> dict[str, Any]:
        """The entry of summary.json."""
        cases = (PLAN, PAPER)
        real = {case: self.errors(case) for case in cases}
        return {
            "repeats": self.repeats,
            "drives": len(self.outcomes[PLAN]),
            "motion": "mujoco" if self.truth is None else "law",
            "truth": self.truth,
            "predicted": self.predicted,
            "real": {case: {name: one.rms for name, one in errors.items()} for case, errors in real.items()},
            "interval95_of_real": {
                case: {name: one.interval95 for name, one in errors.items()} for case, errors in real.items()
            },
            "uncertainty_of_real": {case: sampling_error(len(ones)) for case, ones in self.outcomes.items()},
            "mean": {case: self.means(case) for case in cases},
            "ahead": {case: self.ahead(case) for case in cases},
            "inside": sum(one.numbers[_REACH] <= _MOST for one in self.outcomes[PLAN]),
            "failures": self.failures,
            "checks": [check.to_json() for check in self.checks()],
        }


def try_plan(config: Config, plan: DrivePlan, paper: Expectation | None, run: Run) -> PlanTrials:
    """Try a plan and the paper's runs again and again.

    A robot that is too large for the paper's runs, of which `paper` is the expectation, drives the plan alone.
    """
    simulated = None
    if config.motion == "mujoco":
        with run.progress("drives in MuJoCo", plan.limits.duration + OTHER_DURATIONS) as report:
            simulated = driven_in_mujoco(plan, config.seed, config.threads, report)
    truth = truth_of(plan, generator(config.seed, "truth"))
    counts = {PLAN: config.repeats * (1 if simulated else DRIVES)}
    if paper_runs(plan.knowledge.geometry):
        counts[PAPER] = config.repeats
    trials = [Trial(case, number, simulated) for case, count in counts.items() for number in range(count)]
    poses = SOURCES[config.poses]
    outcomes = run_trials(run, partial(tried, plan=plan, poses=poses, truth=truth), trials, _KEY, plan)
    _, (log,) = _measured(trials[0], generator(config.seed, _KEY.format(case=PLAN, number=0)), plan, poses, truth)
    named = None if simulated else dict(zip(plan.sizes, truth.tolist(), strict=True))
    return PlanTrials(plan, paper, named, config.repeats, outcomes, log)


def truth_of(plan: DrivePlan, rng: np.random.Generator) -> Array:
    """Parameters (q,) of the law that moves a robot.

    Like the shipped robot's on stone; after an identification, drawn from its uncertainty.
    """
    if plan.known is None:
        size = plan.knowledge.geometry.half_gauge / RobotParameters().half_gauge
        like = replace(plan.knowledge, offset=TRUE_LAW["offset"] * size, radius_error=TRUE_LAW["radius_error"])
        return usual_values(plan.law, like)
    at = [list(plan.sizes).index(name) for name in plan.known.names]
    truth = plan.values.copy()
    truth[at] += rng.multivariate_normal(np.zeros(len(at)), plan.known.covariance)
    return truth


def tried(trial: Trial, rng: np.random.Generator, plan: DrivePlan, poses: PoseSource, truth: Array) -> Outcome:
    """Drive, measure and identify.

    `numbers` are, for PLAN, how far the middle of the robot got from that of the area and the largest speed of a belt,
    each as a share of what is allowed; in MuJoCo also errors of other drives predicted 5 s ahead [m], [rad].
    """
    driven, logs = _measured(trial, rng, plan, poses, truth)
    numbers = {_REACH: _reach(plan, driven[0]), _SPEED: _speed(plan, driven[0])} if trial.case == PLAN else {}
    try:
        fit = fit_drives(plan.law, logs, plan.knowledge.geometry)
    except TrackslipError as error:
        return Outcome(numbers=numbers, notes=(str(error),))
    if trial.given is not None:
        numbers |= zip(_AHEAD, prediction_errors(fit, trial.given.others), strict=True)
    return Outcome(Estimate.of(fit), numbers)


def _measured(
    trial: Trial, rng: np.random.Generator, plan: DrivePlan, poses: PoseSource, truth: Array
) -> tuple[list[Driven], list[RunLog]]:
    """The drives of a trial, and their logs: drives in MuJoCo if the trial has them, else by the law."""
    simulated: MujocoDrives | None = trial.given
    if simulated is not None:
        driven = [simulated.plan] if trial.case == PLAN else simulated.paper
    else:
        driven = [driven_by_law(plan, truth, rng)] if trial.case == PLAN else paper_by_law(plan, truth, rng)
    return driven, [one.measured(poses, rng) for one in driven]


def _reach(plan: DrivePlan, driven: Driven) -> float:
    return float((np.abs(driven.motion.pose[:, :2]) / (plan.limits.room / 2)).max())


def _speed(plan: DrivePlan, driven: Driven) -> float:
    """Largest mean speed of a belt in a period, less the resolution of the encoders."""
    radius = plan.knowledge.geometry.sprocket_radius
    step = 2 * np.pi / Drive().encoder_counts * RATE
    return float((np.abs(driven.log.omega).max() - step) * radius / plan.limits.max_speed)
