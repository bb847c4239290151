"""Planned drives tried: what is identified from them and from the paper's runs, beside truth and prediction."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from experiments.driving.plan import Driven, SimulatedDrives, driven_by_law, paper_by_law
from experiments.measuring.check import Check
from experiments.parallel.executors import Workers
from experiments.studies.drive_cases import TRUE_LAW
from experiments.studies.prediction_ahead import ahead
from sim.drive.drive import Drive
from sim.robot.parameters import RobotParameters
from sim.seeds import generator
from sim.wander.pose_source import PoseSource
from trackslip.errors import TrackslipError
from trackslip.identification.drive.estimate import fit_drives
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.metrics import rms
from trackslip.planning.information import Expectation
from trackslip.planning.plan import DrivePlan, expected_alone, paper_runs, usual_values
from trackslip.planning.strokes import RATE
from trackslip.slip.families import family

MIN_REPEATS = 100
"""Repeats from which on root mean squares are held against what is predicted."""
DRIVES = 4
"""Drives of the plan by the law in a repeat: they take a tenth of the time of the paper's runs."""
PLAN, PAPER = "plan", "paper"
"""The planned drive, and the paper's runs."""
_AGREEMENT = (0.8, 1.2)  # real errors over predicted ones
_AS_GOOD = 120.0  # duration from which on a plan is as good as the paper's runs [s]
_OVER_PAPER = {"offset": 1.0, "radius_error": 1.5}  # largest errors over those of the paper's runs
_ROUNDING = 1e-6  # relative


@dataclass(frozen=True)
class Trial:
    """A drive of the plan, or of the paper's runs, to be identified from."""

    source: str
    """PLAN or PAPER."""
    number: int
    plan: DrivePlan
    poses: PoseSource
    seed: int
    truth: Array  # (q,) parameters of the law that moves the robot
    simulated: SimulatedDrives | None = None
    """Drives in MuJoCo, to be measured; None for drives by the law."""


@dataclass(frozen=True)
class Outcome:
    """What came out of a trial."""

    source: str
    number: int
    values: Mapping[str, float]
    """Parameters of the law; empty where the fit failed."""
    stderr: Mapping[str, float]
    """Their standard errors as estimated; none of parameters that were held."""
    reach: float
    """How far the middle of the robot got from that of the area, as a share of what is allowed; 0 for PAPER [-]."""
    speed: float
    """Largest speed of a belt over that allowed; 0 for PAPER [-]."""
    ahead: tuple[float, float] | None
    """Root mean square errors of other drives predicted 5 s ahead, position [m] and heading [rad], in MuJoCo."""
    failure: str | None
    log: RunLog | None
    """The log of the first planned drive."""


def truth_of(plan: DrivePlan, rng: np.random.Generator) -> Array:
    """Parameters (q,) of the law that moves a robot.

    Like the shipped robot's on stone; after an identification, drawn from what that leaves open.
    """
    if plan.known is None:
        size = plan.knowledge.geometry.half_gauge / RobotParameters().half_gauge
        like = replace(plan.knowledge, offset=TRUE_LAW["offset"] * size, radius_error=TRUE_LAW["radius_error"])
        return usual_values(plan.law, like)
    at = [list(plan.sizes).index(name) for name in plan.known.names]
    truth = plan.values.copy()
    truth[at] += rng.multivariate_normal(np.zeros(len(at)), plan.known.covariance)
    return truth


def tried(trial: Trial) -> Outcome:
    """Drive, measure and identify; a fit that fails is recorded."""
    plan, simulated = trial.plan, trial.simulated
    rng = generator(trial.seed, f"trial {trial.number} of {trial.source}")
    planned = trial.source == PLAN
    if simulated is not None:
        driven = [simulated.plan] if planned else simulated.paper
    else:
        driven = [driven_by_law(plan, trial.truth, rng)] if planned else paper_by_law(plan, trial.truth, rng)
    logs = [one.measured(trial.poses, rng) for one in driven]
    fit, failure = None, None
    try:
        fit = fit_drives(plan.law, logs, plan.knowledge.geometry)
    except TrackslipError as error:
        failure = f"{trial.source}: {error}"
    return Outcome(
        trial.source,
        trial.number,
        {} if fit is None else fit.values,
        {} if fit is None else {key: fit.stderr[key] for key in fit.values if key in fit.stderr},
        _reach(plan, driven[0]) if planned else 0.0,
        _speed(plan, driven[0]) if planned else 0.0,
        ahead(fit, simulated.others) if fit is not None and simulated is not None else None,
        failure,
        logs[0] if planned and trial.number == 0 else None,
    )


def try_plan(
    plan: DrivePlan,
    paper: Expectation | None,
    poses: PoseSource,
    repeats: int,
    seed: int,
    simulated: SimulatedDrives | None,
    pool: Workers,
    step: Callable[[float], None],
) -> Trials:
    """Try a plan and the paper's runs again and again; `step(1.0)` is called after each of them.

    A robot that is too large for the paper's runs, of which `paper` is what they would tell, drives the plan alone.
    """
    truth = truth_of(plan, generator(seed, "truth"))
    counts = {
        PLAN: repeats * (1 if simulated else DRIVES),
        PAPER: repeats if paper_runs(plan.knowledge.geometry) else 0,
    }
    tasks = [
        Trial(source, number, plan, poses, seed, truth, simulated)
        for source, count in counts.items()
        for number in range(count)
    ]
    found: dict[tuple[str, int], Outcome] = {}
    for outcome in pool.each(tried, tasks):
        found[outcome.source, outcome.number] = outcome
        step(1.0)
    outcomes = tuple(found[trial.source, trial.number] for trial in tasks)
    return Trials(plan, paper, truth, repeats, outcomes, simulated is not None)


@dataclass(frozen=True)
class Trials:
    """All repeats of a plan."""

    plan: DrivePlan
    paper: Expectation | None
    """What the paper's runs would tell."""
    truth: Array
    repeats: int
    outcomes: tuple[Outcome, ...]
    simulated: bool
    """Whether MuJoCo moved the robot, once: repeats measure the same drives again."""

    def of(self, source: str) -> list[Outcome]:
        """The outcomes from PLAN or PAPER."""
        return [one for one in self.outcomes if one.source == source]

    @property
    def log(self) -> RunLog | None:
        """The log of the first planned drive."""
        return self.outcomes[0].log

    @property
    def failures(self) -> list[str]:
        """Why fits failed, once each."""
        return sorted({one.failure for one in self.outcomes if one.failure is not None})

    def errors(self, source: str) -> dict[str, float]:
        """Root mean square errors of the parameters, identified from PLAN or PAPER, in their units.

        In MuJoCo, where the truth isn't known, these are standard deviations between repeats.
        """
        found = {}
        for name, true in zip(family(self.plan.law).names, self.truth.tolist(), strict=True):
            values = [one.values[name] for one in self.of(source) if name in one.stderr]
            centre = float(np.mean(values)) if self.simulated and values else true
            found[name] = rms(np.array(values) - centre) if values else np.nan
        return found

    @cached_property
    def predicted(self) -> dict[str, dict[str, float]]:
        """Standard errors expected from each, without what was known before; empty where nothing is."""
        plan = self.plan.expectation if self.plan.known is None else expected_alone(self.plan)
        return {PLAN: dict(plan.stderr), PAPER: {} if self.paper is None else dict(self.paper.stderr)}

    def ahead(self, source: str) -> tuple[float, float] | None:
        """Errors of other drives predicted by the laws, position [m] and heading [rad]; None if there are none."""
        found = [one.ahead for one in self.of(source) if one.ahead is not None]
        return None if not found else (rms([one[0] for one in found]), rms([one[1] for one in found]))

    def checks(self) -> list[Check]:
        """What has to hold."""
        case = f"{len(self.of(PLAN))} drives of {self.plan.limits.duration:g} s"
        reach, speed = (max(getattr(one, name) for one in self.outcomes) for name in ("reach", "speed"))
        most = 1 + _ROUNDING
        found = [
            Check(case, "fits that failed", float(sum(one.failure is not None for one in self.outcomes)), 0.0, "1"),
            Check(case, "farthest from the middle, of what the area allows", reach, most, "1"),
            Check(case, "largest speed, of what is allowed", speed, most, "1"),
        ]
        if self.simulated:
            plan, paper = self.ahead(PLAN), self.ahead(PAPER)
            if plan is not None and paper is not None:
                for what, mine, theirs in zip(("position", "heading"), plan, paper, strict=True):
                    about = f"{what} of another drive in 5 s, error over that of the paper's runs"
                    found.append(Check(case, about, mine / theirs, 1.2, "1"))
        elif self.repeats >= MIN_REPEATS:
            found += self._statistics(case)
        return found

    def _statistics(self, case: str) -> list[Check]:
        """Real errors against predicted ones, and against those expected of the paper's runs.

        Unlike the real errors from the paper's runs, what is expected has no sampling error.
        """
        real, predicted, bound = self.errors(PLAN), self.predicted[PLAN], self.predicted[PAPER]
        found = [
            Check(case, f"real over predicted error of {name}", error / predicted[name], _AGREEMENT, "1")
            for name, error in real.items()
            if name in predicted
        ]
        if self.plan.limits.duration < _AS_GOOD:
            return found
        return found + [
            Check(
                case,
                f"error of {name} over the least that the paper's runs can have",
                real[name] / bound[name],
                most,
                "1",
            )
            for name, most in _OVER_PAPER.items()
            if name in real and name in bound
        ]

    def to_json(self) -> dict[str, Any]:
        """What summary.json says of the trials."""
        sources, drives = (PLAN, PAPER), self.of(PLAN)
        return {
            "repeats": self.repeats,
            "drives": len(drives),
            "motion": "mujoco" if self.simulated else "law",
            "truth": None if self.simulated else self._named(self.truth),
            "predicted": self.predicted,
            "real": {source: self.errors(source) for source in sources},
            "uncertainty_of_real": {
                source: sampling_error(len(self.of(source))) for source in sources if self.of(source)
            },
            "mean": {source: self._means(source) for source in sources},
            "ahead": {source: self.ahead(source) for source in sources},
            "inside": sum(one.reach <= 1 + _ROUNDING for one in drives),
            "failures": self.failures,
            "checks": [check.to_json() for check in self.checks()],
        }

    def _named(self, values: Array) -> dict[str, float]:
        return dict(zip(family(self.plan.law).names, values.tolist(), strict=True))

    def _means(self, source: str) -> dict[str, float]:
        values = [one.values for one in self.of(source) if one.values]
        return {name: float(np.mean([one[name] for one in values])) for name in family(self.plan.law).names if values}


def sampling_error(count: int) -> float:
    """Relative standard error of a root mean square of so many normal errors, at least one."""
    return float(1 / np.sqrt(2 * count))


def _reach(plan: DrivePlan, driven: Driven) -> float:
    return float((np.abs(driven.motion.pose[:, :2]) / (plan.limits.room / 2)).max())


def _speed(plan: DrivePlan, driven: Driven) -> float:
    """Largest mean speed of a belt in a period, less what one count of the encoder makes of it."""
    radius = plan.knowledge.geometry.sprocket_radius
    step = 2 * np.pi / Drive().encoder_counts * RATE
    return float((np.abs(driven.log.omega).max() - step) * radius / plan.limits.max_speed)
