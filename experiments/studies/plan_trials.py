"""Trials of a planned drive: laws identified from it and from the paper's runs, against truth and prediction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.common.check import Check, checks_table
from experiments.common.formats import number, significant
from experiments.common.laws import symbol, unit_of
from experiments.common.table import Table
from experiments.simulate.drives import KnownDrive, driven_by_law, driven_in_mujoco
from experiments.simulate.options import DriveOptions, Simulation
from experiments.simulate.world import Specification, World
from experiments.studies.drive_coverage import TRUE_LAW
from experiments.studies.trials import (
    Estimate,
    Estimates,
    Study,
    Trial,
    TrialOutcome,
    Values,
    failures_of,
    rms_interval,
    run_trials,
    sampling_error,
)
from sim.drive.drive import Drive
from sim.loop import Progress
from sim.robot.parameters import RobotParameters
from sim.run_recorder import Description
from sim.seeds import generator
from sim.wander.commands import Driver, track_commands
from sim.wander.motion import LawMotion, Motion, SlipVariation
from sim.wander.pose_source import SOURCES, PoseSource
from trackslip import se2
from trackslip.errors import TrackslipError, counted
from trackslip.identification.drive_law import DriveFit, fit_drives
from trackslip.identification.drives import drive_of
from trackslip.kinematics import Array, wrap_angle
from trackslip.logs.runlog import RunLog
from trackslip.metrics import body_errors, rms
from trackslip.planning.information import Expectation, with_extras
from trackslip.planning.maneuvers import RATE
from trackslip.planning.plan import PAPER_DURATION, DrivePlan, expected_alone, paper_runs, usual_values
from trackslip.slip.families import family

if TYPE_CHECKING:
    from experiments.common.run import Run
    from experiments.plan.config import Config

MIN_REPEATS = 100
"""Minimum repeats before RMS errors are compared with the prediction."""
DRIVES = 4
"""Drives of the plan by the law in a repeat: they take a tenth of the time of the paper's runs."""
PLAN, PAPER = "plan", "paper"
"""The cases: the planned drive, and the paper's runs."""
_OTHERS = "others"  # drives in MuJoCo that the laws predict
_COUNT, _OTHER_DURATION = 4, 60.0  # of those, and of each [s]
_HORIZON, _EVERY = 5.0, 0.5  # of predictions, and between them [s]
_PAPER_RATE = 10.0  # of the encoders in the paper's runs, whose speeds are constant [Hz]
_KEY = "trial {number} of {case}"
_AHEAD = ("position", "heading")
_AGREEMENT = (0.8, 1.2)  # real errors over predicted ones
_AS_GOOD = 120.0  # duration from which on a plan is as good as the paper's runs [s]
_OVER_PAPER = {"offset": 1.0, "radius_error": 1.5}  # largest errors over those of the paper's runs
_MOST = 1 + 1e-6  # of what is allowed, for rounding [-]

Drives = Mapping[str, Sequence[KnownDrive]]  # by case


def try_plan(config: Config, plan: DrivePlan, paper: Expectation | None, run: Run) -> tuple[Study, RunLog]:
    """Try a plan and the paper's runs again and again; with the log of the first planned drive.

    A robot that is too large for the paper's runs, of which `paper` is the expectation, drives the plan alone.
    """
    simulated: Drives | None = None
    if config.motion == "mujoco":
        with run.progress("drives in MuJoCo", plan.limits.duration + PAPER_DURATION + _OTHER_DURATION) as report:
            simulated = mujoco_drives(plan, config.seed, config.threads, report)
    truth = truth_of(plan, generator(config.seed, "truth"))
    counts = {PLAN: config.repeats * (1 if simulated else DRIVES)}
    if paper_runs(plan.knowledge.geometry):
        counts[PAPER] = config.repeats
    trials = [Trial(case, number, simulated) for case, count in counts.items() for number in range(count)]
    poses = SOURCES[config.poses]
    outcomes = run_trials(run, partial(tried, plan=plan, poses=poses, truth=truth), trials, _KEY, plan)
    _, (log,) = _measured(trials[0], generator(config.seed, _KEY.format(case=PLAN, number=0)), plan, poses, truth)
    named = None if simulated else dict(zip(plan.sizes, truth.tolist(), strict=True))
    return plan_study(plan, paper, named, config.repeats, outcomes), log


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


def tried(trial: Trial, rng: np.random.Generator, plan: DrivePlan, poses: PoseSource, truth: Array) -> TrialOutcome:
    """Drive, measure and identify.

    `numbers` are, for PLAN, how far the middle of the robot got from that of the area and the largest speed of a belt,
    each as a share of what is allowed; in MuJoCo also errors of other drives predicted 5 s ahead [m], [rad].
    """
    driven, logs = _measured(trial, rng, plan, poses, truth)
    numbers = _used(plan, driven[0]) if trial.case == PLAN else {}
    try:
        fit = fit_drives(plan.law, logs, plan.knowledge.geometry)
    except TrackslipError as error:
        return TrialOutcome(numbers=numbers, notes=(str(error),))
    if trial.given is not None:
        numbers |= zip(_AHEAD, prediction_errors(fit, trial.given[_OTHERS]), strict=True)
    return TrialOutcome(Estimate.of(fit), numbers)


def _measured(
    trial: Trial, rng: np.random.Generator, plan: DrivePlan, poses: PoseSource, truth: Array
) -> tuple[Sequence[KnownDrive], list[RunLog]]:
    """The drives of a trial, and their logs: drives in MuJoCo if the trial has them, else by the law."""
    driven = trial.given[trial.case] if trial.given else _driven_by_law(plan, trial.case, truth, rng)
    return driven, [one.measured(poses, rng) for one in driven]


def _driven_by_law(plan: DrivePlan, case: str, truth: Array, rng: np.random.Generator) -> list[KnownDrive]:
    """The planned drive or the paper's runs by the law with the parameters `truth` (q,), with white slip."""
    geometry, counts = plan.knowledge.geometry, Drive().encoder_counts
    law = LawMotion(family(plan.law).law(truth, geometry), geometry, SlipVariation(*plan.knowledge.slip))
    if case == PLAN:
        readings = np.concatenate([plan.omega[:1], plan.omega[:-1]])  # means since the row before
        return [driven_by_law("plan", law, readings, RATE, rng, plan.start, counts)]
    rows = round(PAPER_DURATION * _PAPER_RATE) + 1
    circles = [np.tile(speeds / geometry.sprocket_radius, (rows, 1)) for speeds in paper_runs(geometry)]
    return [driven_by_law(f"circle {k + 1}", law, one, _PAPER_RATE, rng, None, counts) for k, one in enumerate(circles)]


def mujoco_drives(plan: DrivePlan, seed: int, threads: int, progress: Progress) -> dict[str, list[KnownDrive]]:
    """The planned drive, the paper's runs and other drives, on the shipped ground.

    The robot is the shipped one but for gauge and sprockets. `progress` is called with the simulated seconds; raises
    RunFailedError when a robot tips over.
    """
    geometry, limits, circles = plan.knowledge.geometry, plan.limits, paper_runs(plan.knowledge.geometry)
    top_speed = max(limits.max_speed, Drive().top_speed, *(float(np.abs(v).max()) for v in circles))
    config = Simulation(seed=seed, threads=threads, drive=DriveOptions(top_speed=top_speed))
    given = Specification.of(config)
    parameters = replace(given.parameters, half_gauge=geometry.half_gauge, sprocket_radius=geometry.sprocket_radius)
    world = World.of(config, replace(given, parameters=parameters))

    def drive(name: str, speeds: Sequence[Array]) -> list[KnownDrive]:
        about = [Description(f"{name} {k + 1}", world.metadata("truth")) for k in range(len(speeds))]
        omega = [one / geometry.sprocket_radius for one in speeds]
        fleet = world.fleet(np.zeros((len(speeds), 3)))
        return driven_in_mujoco(fleet, omega, RATE, about, progress) if len(speeds) else []

    (planned,) = drive("plan", [plan.speeds])
    motion = Motion(planned.motion.time, se2.compose(plan.start, planned.motion.pose))
    driver = Driver(limits.max_speed, limits.acceleration, plan.knowledge.reach)
    commands = [generator(seed, f"plan other {k}") for k in range(_COUNT)]
    return {
        PLAN: [KnownDrive(replace(planned.log, pose=motion.pose), motion)],
        PAPER: drive("circle", [np.tile(one, (round(PAPER_DURATION * RATE) + 1, 1)) for one in circles]),
        _OTHERS: drive("other", [track_commands("random", _OTHER_DURATION, RATE, driver, rng) for rng in commands]),
    }


def _used(plan: DrivePlan, driven: KnownDrive) -> dict[str, float]:
    """Largest distance from the middle of the area and mean speed of a belt in a period, of what is allowed [-]."""
    reach = float((np.abs(driven.motion.pose[:, :2]) / (plan.limits.room / 2)).max())
    step = 2 * np.pi / Drive().encoder_counts * RATE  # resolution of the encoders
    speed = (np.abs(driven.log.omega).max() - step) * plan.knowledge.geometry.sprocket_radius
    return {"reach": reach, "speed": float(speed / plan.limits.max_speed)}


def prediction_errors(fit: DriveFit, others: Sequence[KnownDrive]) -> tuple[float, float]:
    """Root mean square errors of the position [m] and heading [rad] of drives, predicted 5 s ahead by the law alone."""
    values = with_extras(fit.fit.values[: len(fit.values)])
    missed = []
    for other in others:
        drive = drive_of(other.log)
        start = np.arange(0, len(drive.pose) - round(_HORIZON * RATE), round(_EVERY * RATE))
        end = start + round(_HORIZON * RATE)
        expected = fit.fit.model.sensor_path(values, drive)
        missed.append(body_errors(expected[start], expected[end]) - body_errors(drive.pose[start], drive.pose[end]))
    x, y, turn = np.concatenate(missed).T
    return rms(np.hypot(x, y)), rms(wrap_angle(turn))


def plan_study(
    plan: DrivePlan,
    paper: Expectation | None,
    truth: Values | None,
    repeats: int,
    outcomes: Mapping[str, Sequence[TrialOutcome]],
) -> Study:
    """Compare the estimates with the truth and with what was predicted.

    Args:
        plan: that was tried.
        paper: standard errors to expect of the paper's runs.
        truth: parameters of the law that moves the robot; None in MuJoCo, where repeats measure the same drives again,
            and errors are from their mean.
        repeats: of the paper's runs.
        outcomes: by case, PLAN or PAPER.
    """
    by_case = {case: outcomes.get(case, []) for case in (PLAN, PAPER)}
    estimates = {case: {name: Estimates.of(ones, name) for name in plan.sizes} for case, ones in by_case.items()}
    mean = {
        case: {name: float(one.value[one.known].mean()) for name, one in found.items() if one.known.any()}
        for case, found in estimates.items()
    }
    errors = {
        case: {name: one.errors((truth or mean[case]).get(name, np.nan)) for name, one in found.items()}
        for case, found in estimates.items()
    }
    alone = plan.expectation if plan.known is None else expected_alone(plan)
    real = {case: {name: rms(found) for name, found in of_case.items()} for case, of_case in errors.items()}
    predicted = {PLAN: dict(alone.stderr), PAPER: {} if paper is None else dict(paper.stderr)}
    ahead = {case: _ahead(ones) for case, ones in by_case.items()}
    summary = {
        "repeats": repeats,
        "drives": len(by_case[PLAN]),
        "motion": "mujoco" if truth is None else "law",
        "truth": truth,
        "predicted": predicted,
        "real": real,
        "interval95_of_real": {case: {name: rms_interval(e) for name, e in of.items()} for case, of in errors.items()},
        "uncertainty_of_real": {case: sampling_error(len(ones)) for case, ones in outcomes.items()},
        "mean": mean,
        "ahead": ahead,
        "inside": sum(one.numbers["reach"] <= _MOST for one in by_case[PLAN]),
        "failures": [f"{case}: {line}" for case in sorted(outcomes) for line in failures_of(outcomes[case])],
    }
    checks = list(_checks(plan, by_case, summary))
    rows = []
    for name in plan.sizes:
        factor, unit = unit_of(plan.law, name)
        mine, theirs = (predicted[case].get(name) for case in (PLAN, PAPER))
        columns = (mine, real[PLAN][name], theirs, real[PAPER][name])
        printed = [significant(None if error is None else factor * error, unit) for error in columns]
        rows.append(
            (symbol(plan.law, name), *printed[:2], number(real[PLAN][name] / mine if mine else None, 2), *printed[2:])
        )
    title = f"A drive in MuJoCo, measured {counted(repeats, 'time')}: standard deviations between measurements"
    shown: list[Table | str] = []
    if truth is not None:
        driven = f"{counted(len(by_case[PLAN]), 'drive')} of the plan, {counted(repeats, 'time')} the paper's runs"
        title = f"{driven}, moved by the law: root mean square errors"
        uncertain = [f"{case} {error:.0%}" for case, error in summary["uncertainty_of_real"].items()]
        shown = [f"so many drives leave real errors uncertain by: {', '.join(uncertain)}"]
    header = ("parameter", "predicted", "real", "real / predicted", "paper predicted", "paper real")
    return Study(summary, [Table(title, header, rows), *shown, checks_table("Checks", checks)], checks)


def _ahead(outcomes: Sequence[TrialOutcome]) -> tuple[float, ...] | None:
    """RMS errors of other drives predicted by the laws, position [m] and heading [rad]; None if there are none."""
    found = [one.numbers for one in outcomes if _AHEAD[0] in one.numbers]
    return tuple(rms([numbers[name] for numbers in found]) for name in _AHEAD) if found else None


def _checks(
    plan: DrivePlan, outcomes: Mapping[str, Sequence[TrialOutcome]], summary: Mapping[str, Any]
) -> Iterator[Check]:
    """Fits, limits of the drive, and errors relative to the prediction and to the paper's runs."""
    case = f"{counted(len(outcomes[PLAN]), 'drive')} of {plan.limits.duration:g} s"
    failed = sum(bool(one.notes) for ones in outcomes.values() for one in ones)
    reach, speed = (max(one.numbers[name] for one in outcomes[PLAN]) for name in ("reach", "speed"))
    yield Check(case, "fits that failed", float(failed), 0.0)
    yield Check(case, "farthest from the middle, of what the area allows", reach, _MOST)
    yield Check(case, "largest speed, of what is allowed", speed, _MOST)
    mine, theirs = summary["ahead"][PLAN], summary["ahead"][PAPER]
    if mine and theirs:
        for what, own, of_paper in zip(_AHEAD, mine, theirs, strict=True):
            yield Check(
                case, f"{what} of another drive in 5 s, error over that of the paper's runs", own / of_paper, 1.2
            )
    if summary["truth"] is None or summary["repeats"] < MIN_REPEATS:
        return
    real, predicted, least = summary["real"][PLAN], summary["predicted"][PLAN], summary["predicted"][PAPER]
    for name in (name for name in real if name in predicted):
        over = real[name] / predicted[name]
        yield Check(case, f"real over predicted error of {name}", over, _AGREEMENT, source="Fisher information")
    if plan.limits.duration >= _AS_GOOD:
        for name in (name for name in _OVER_PAPER if name in real and name in least):
            over = real[name] / least[name]
            yield Check(case, f"error of {name} over the least that the paper's runs can have", over, _OVER_PAPER[name])
