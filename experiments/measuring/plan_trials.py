"""Planned drives tried: what is identified from them and from the paper's runs, beside truth and prediction."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from experiments.driving.plan import Driven, SimulatedDrives, driven_by_law, paper_by_law
from experiments.measuring.drive_cases import TRUE_LAW
from experiments.measuring.drive_coverage import Check
from experiments.parallel.executors import Workers
from sim.drive.drive import Drive
from sim.robot.parameters import RobotParameters
from sim.seeds import generator
from sim.wander.pose_source import PoseSource
from trackslip.errors import TrackslipError
from trackslip.identification.drive.drives import drive_of
from trackslip.identification.drive.estimate import DriveFit, fit_drives
from trackslip.identification.drive.reckoning import rotated
from trackslip.kinematics import Array, wrap_angle
from trackslip.logs.runlog import RunLog
from trackslip.metrics import rms
from trackslip.planning.information import with_extras
from trackslip.planning.plan import DrivePlan, expected_alone, expected_of_paper
from trackslip.planning.strokes import RATE
from trackslip.slip.families import family

MIN_REPEATS = 100
"""Repeats from which on root mean squares are held against what is predicted."""
PLAN, PAPER = "plan", "paper"
"""The planned drive, and the paper's runs."""
_HORIZON = 5.0  # of predictions of other drives [s]
_EVERY = 0.5  # between those [s]
_AGREEMENT = (0.8, 1.2)  # real errors over predicted ones
_AS_GOOD = 120.0  # duration from which on a plan is as good as the paper's runs [s]
_OVER_PAPER = {"offset": 1.0, "radius_error": 1.5}  # largest errors over those of the paper's runs
_ROUNDING = 1e-6  # relative


@dataclass(frozen=True)
class Trial:
    """A repeat."""

    number: int
    plan: DrivePlan
    source: PoseSource
    seed: int
    truth: Array  # (q,) parameters of the law that moves the robot
    simulated: SimulatedDrives | None = None
    """Drives in MuJoCo, to be measured; None for drives by the law."""


@dataclass(frozen=True)
class Outcome:
    """What came out of a trial."""

    number: int
    values: Mapping[str, Mapping[str, float]]
    """Parameters of the law by what they were identified from, PLAN and PAPER."""
    stderr: Mapping[str, Mapping[str, float]]
    """Their standard errors as estimated."""
    reach: float
    """How far the middle of the robot got from that of the area, as a share of what is allowed [-]."""
    speed: float
    """Largest speed of a belt over that allowed [-]."""
    acceleration: float
    """Largest acceleration commanded over that allowed [-]."""
    ahead: Mapping[str, tuple[float, float]]
    """Root mean square errors of other drives predicted 5 s ahead, position [m] and heading [rad], in MuJoCo."""
    failures: tuple[str, ...]
    log: RunLog | None
    """The first trial's log of the planned drive."""


def truth_of(plan: DrivePlan) -> Array:
    """Parameters (q,) of the law that moves a robot: those known before, else like the shipped robot's on stone."""
    if plan.known is not None:
        return plan.values
    size = plan.knowledge.geometry.half_gauge / RobotParameters().half_gauge
    like = {"offset": TRUE_LAW["offset"] * size, "radius_error": TRUE_LAW["radius_error"]}
    names = family(plan.law).names
    return np.array(
        [
            like.get(name.removesuffix("_left").removesuffix("_right"), value)
            for name, value in zip(names, plan.values.tolist(), strict=True)
        ]
    )


def tried(trial: Trial) -> Outcome:
    """Drive, measure and identify; a fit that fails is recorded."""
    mine, theirs = (generator(trial.seed, f"trial {trial.number} of {source}") for source in (PLAN, PAPER))
    plan = trial.plan
    if trial.simulated is None:
        planned, paper = driven_by_law(plan, trial.truth, mine), paper_by_law(plan, trial.truth, theirs)
    else:
        planned, paper = trial.simulated.plan, trial.simulated.paper
    logs = {PLAN: [planned.measured(trial.source, mine)], PAPER: [one.measured(trial.source, theirs) for one in paper]}
    fits: dict[str, DriveFit] = {}
    failures = []
    for name, measured in logs.items():
        try:
            fits[name] = fit_drives(plan.law, measured, plan.knowledge.geometry)
        except TrackslipError as error:
            failures.append(f"{name}: {error}")
    others = trial.simulated.others if trial.simulated else []
    return Outcome(
        trial.number,
        {name: fit.values for name, fit in fits.items()},
        {name: {key: fit.stderr[key] for key in fit.values if key in fit.stderr} for name, fit in fits.items()},
        _reach(plan, planned),
        _speed(plan, planned),
        _acceleration(plan),
        {name: ahead(fit, others) for name, fit in fits.items()} if others else {},
        tuple(failures),
        logs[PLAN][0] if trial.number == 0 else None,
    )


def try_plan(
    plan: DrivePlan,
    source: PoseSource,
    repeats: int,
    seed: int,
    simulated: SimulatedDrives | None,
    pool: Workers,
    step: Callable[[float], None],
) -> Trials:
    """Try a plan again and again; `step(1.0)` is called after each repeat."""
    truth = truth_of(plan)
    tasks = [Trial(number, plan, source, seed, truth, simulated) for number in range(repeats)]
    found: dict[int, Outcome] = {}
    for outcome in pool.each(tried, tasks):
        found[outcome.number] = outcome
        step(1.0)
    return Trials(plan, truth, tuple(found[number] for number in range(repeats)), simulated is not None)


@dataclass(frozen=True)
class Trials:
    """All repeats of a plan."""

    plan: DrivePlan
    truth: Array
    outcomes: tuple[Outcome, ...]
    simulated: bool
    """Whether MuJoCo moved the robot."""

    @property
    def failures(self) -> list[str]:
        """Why fits failed, once each."""
        return sorted({line for one in self.outcomes for line in one.failures})

    def errors(self, source: str) -> dict[str, float]:
        """Root mean square errors of the parameters, identified from PLAN or PAPER, in their units.

        In MuJoCo, where the truth isn't known, these are standard deviations between repeats.
        """
        found = {}
        for name, true in zip(family(self.plan.law).names, self.truth.tolist(), strict=True):
            values = [one.values[source][name] for one in self.outcomes if name in one.stderr.get(source, {})]
            centre = float(np.mean(values)) if self.simulated and values else true
            found[name] = rms(np.array(values) - centre) if values else np.nan
        return found

    @cached_property
    def predicted(self) -> dict[str, dict[str, float]]:
        """Standard errors expected from each, without what was known before; empty where nothing is."""
        paper = expected_of_paper(self.plan)
        return {PLAN: dict(expected_alone(self.plan).stderr), PAPER: dict(paper.stderr) if paper else {}}

    def ahead(self, source: str) -> tuple[float, float] | None:
        """Errors of other drives predicted by the laws, position [m] and heading [rad]; None if there are none."""
        found = [one.ahead[source] for one in self.outcomes if source in one.ahead]
        return None if not found else (rms([one[0] for one in found]), rms([one[1] for one in found]))

    def checks(self) -> list[Check]:
        """What has to hold."""
        number = len(self.outcomes)
        case = f"{number} drives of {self.plan.limits.duration:g} s"
        reach, speed, acceleration = (
            max(getattr(one, name) for one in self.outcomes) for name in ("reach", "speed", "acceleration")
        )
        most = 1 + _ROUNDING
        found = [
            Check(case, "fits that failed", float(sum(bool(one.failures) for one in self.outcomes)), 0.0, "1"),
            Check(case, "farthest from the middle, of what the area allows", reach, most, "1"),
            Check(case, "largest speed, of what is allowed", speed, most, "1"),
            Check(case, "largest acceleration, of what is allowed", acceleration, most, "1"),
        ]
        if self.simulated:
            plan, paper = self.ahead(PLAN), self.ahead(PAPER)
            if plan is not None and paper is not None:
                for what, mine, theirs in zip(("position", "heading"), plan, paper, strict=True):
                    about = f"{what} of another drive in 5 s, error over that of the paper's runs"
                    found.append(Check(case, about, mine / theirs, 1.2, "1"))
        elif number >= MIN_REPEATS:
            found += self._statistics(case)
        return found

    def _statistics(self, case: str) -> list[Check]:
        real, predicted = self.errors(PLAN), self.predicted[PLAN]
        found = [
            Check(case, f"real over predicted error of {name}", error / predicted[name], _AGREEMENT, "1")
            for name, error in real.items()
            if name in predicted
        ]
        if self.plan.limits.duration < _AS_GOOD:
            return found
        paper = self.errors(PAPER)
        return found + [
            Check(case, f"error of {name} over that of the paper's runs", real[name] / paper[name], most, "1")
            for name, most in _OVER_PAPER.items()
            if name in real
        ]

    def to_json(self) -> dict[str, Any]:
        """What summary.json says of the trials."""
        sources = (PLAN, PAPER)
        return {
            "repeats": len(self.outcomes),
            "motion": "mujoco" if self.simulated else "law",
            "truth": None if self.simulated else self._named(self.truth),
            "predicted": self.predicted,
            "real": {source: self.errors(source) for source in sources},
            "mean": {source: self._means(source) for source in sources},
            "ahead": {source: self.ahead(source) for source in sources},
            "inside": sum(one.reach <= 1 + _ROUNDING for one in self.outcomes),
            "failures": self.failures,
            "checks": [check.to_json() for check in self.checks()],
        }

    def _named(self, values: Array) -> dict[str, float]:
        return dict(zip(family(self.plan.law).names, values.tolist(), strict=True))

    def _means(self, source: str) -> dict[str, float]:
        values = [one.values[source] for one in self.outcomes if source in one.values]
        return {name: float(np.mean([one[name] for one in values])) for name in family(self.plan.law).names if values}


def ahead(fit: DriveFit, others: Sequence[Driven]) -> tuple[float, float]:
    """Root mean square errors of the position [m] and heading [rad] of drives, predicted 5 s ahead by the law alone."""
    values = with_extras(fit.fit.values[: len(fit.values)])
    missed = []
    for other in others:
        drive = drive_of(other.log)
        path, real = fit.fit.model.sensor_path(values, drive), drive.pose
        start = np.arange(0, len(real) - round(_HORIZON * RATE), round(_EVERY * RATE))
        end = start + round(_HORIZON * RATE)
        wrong = _moved(path, start, end) - _moved(real, start, end)
        missed.append(np.column_stack([wrong[:, :2], wrap_angle(wrong[:, 2])]))
    every = np.concatenate(missed)
    return rms(np.hypot(every[:, 0], every[:, 1])), rms(every[:, 2])


def _moved(pose: Array, start: np.ndarray, end: np.ndarray) -> Array:
    """Motion (n, 3) between poses, in the frame of the first."""
    way = rotated(-pose[start, 2], pose[end, :2] - pose[start, :2])
    return np.column_stack([way, pose[end, 2] - pose[start, 2]])


def _reach(plan: DrivePlan, driven: Driven) -> float:
    return float((np.abs(driven.motion.pose[:, :2]) / (plan.limits.room / 2)).max())


def _speed(plan: DrivePlan, driven: Driven) -> float:
    """Largest mean speed of a belt in a period, less what one count of the encoder makes of it."""
    radius = plan.knowledge.geometry.sprocket_radius
    step = 2 * np.pi / Drive().encoder_counts * RATE
    return float((np.abs(driven.log.omega).max() - step) * radius / plan.limits.max_speed)


def _acceleration(plan: DrivePlan) -> float:
    change = np.diff(plan.speeds, axis=0, prepend=np.zeros((1, 2)))
    return float(np.abs(change).max() * RATE / plan.limits.acceleration)
