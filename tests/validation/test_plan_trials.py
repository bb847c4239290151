"""Planned drives, driven: errors of the law identified from each against those predicted, and the
paper's runs beside.

`pytest -m slow tests/validation/test_plan_trials.py -s` prints the tables of
docs/shortest_experiment.md, in minutes.
"""

from functools import partial

import numpy as np
import pytest
from law_motion import LawMotion, SlipVariation, driven_by_law
from trials import LAW, TRUE_LAW, Estimate, Estimates, identified, outcomes, report

from experiments.common.check import Check
from experiments.common.table import Table, significant
from sim import Drive
from sim.common.seeds import generator
from sim.wander.motion import joined_log
from sim.wander.pose_sensor import POSE_SENSORS
from trackslip.kinematics import RobotGeometry
from trackslip.laws.families import FAMILIES
from trackslip.planning.information import PoseQuality
from trackslip.planning.limits import DriveLimits
from trackslip.planning.plan import (
    PAPER_DURATION,
    DrivePlan,
    expected_of_paper,
    paper_runs,
    plan_drive,
)
from trackslip.planning.route import RATE
from trackslip.views.symbols import symbol, unit_of

pytestmark = pytest.mark.slow
GEOMETRY = RobotGeometry(0.168, 0.06)
SLAM = POSE_SENSORS["slam"]
PLANNED = 400  # drives of the plan by the law
PAPER = 100  # repeats of the paper's 25 runs
PAPER_RATE = 10.0  # of the encoders in the paper's runs, whose speeds are constant [Hz]
AGREEMENT = (0.8, 1.2)
"""Real errors over predicted ones."""
OVER_PAPER = {"offset": 1.0, "radius_error": 1.5}
"""Largest errors of a plan of 120 s over those predicted for the paper's runs."""
ROUNDING = 1 + 1e-6


def planned(duration: float) -> DrivePlan:
    """The plan of `trackslip plan --half-gauge 0.168 --sprocket-radius 0.06 --duration
    DURATION`.
    """
    poses = PoseQuality(SLAM.rate, SLAM.position_noise, SLAM.heading_noise)
    limits = DriveLimits(0.3, 0.5, (3.0, 3.0), duration, 0.0)
    return plan_drive(GEOMETRY, limits, poses, LAW)


def rms_errors(trials: list[dict[str, Estimate]]) -> dict[str, float]:
    """Root mean square errors of the law's parameters."""
    return {name: Estimates.of(trials, name).rms_error(value) for name, value in TRUE_LAW.items()}


def row_of(name: str, *errors: float) -> tuple[str, ...]:
    """The symbol of a parameter and errors of it, in its unit."""
    factor, unit = unit_of(LAW, name)
    return symbol(LAW, name), *(significant(factor * error, unit, 3) for error in errors)


def test_a_plan_and_the_papers_runs_by_a_law():
    plan = planned(120.0)
    paper = expected_of_paper(plan)
    assert paper is not None
    plan_predicted = plan.expectation.stderr
    paper_predicted = paper.stderr

    driven = outcomes(partial(drive_plan, plan=plan), range(PLANNED))
    plan_trials = [trial for trial, _, _ in driven]
    paper_trials = outcomes(partial(drive_paper_runs, plan=plan), range(PAPER))
    plan_real = rms_errors(plan_trials)
    paper_real = rms_errors(paper_trials)
    rows = []
    for name in TRUE_LAW:
        of_plan = (plan_predicted[name], plan_real[name])
        of_paper = (paper_predicted[name], paper_real[name])
        rows.append(row_of(name, *of_plan, *of_paper))
    header = ("parameter", "plan predicted", "real", "paper's runs predicted", "real")
    print()
    Table(f"{PLANNED} drives of the plan, {PAPER} times the paper's runs", header, rows).print()

    failed = sum(not trial for trial in plan_trials + paper_trials)
    reach = max(reach for _, reach, _ in driven)
    speed = max(speed for _, _, speed in driven)
    case = f"{PLANNED} drives of {plan.limits.duration:g} s"
    checks = [
        Check(case, "fits that failed", float(failed), 0.0),
        Check(case, "farthest from the middle, of what the area allows", reach, ROUNDING),
        Check(case, "largest speed, of what is allowed", speed, ROUNDING),
    ]
    for name, most in OVER_PAPER.items():
        over_own = plan_real[name] / plan_predicted[name]
        over_paper = plan_real[name] / paper_predicted[name]
        over = f"error of {name} over that predicted for the paper's runs"
        checks.append(Check(case, f"real over predicted error of {name}", over_own, AGREEMENT))
        checks.append(Check(case, over, over_paper, most))
    report("The plan and the paper's runs", checks)


def law_motion(plan: DrivePlan) -> LawMotion:
    law = FAMILIES[LAW].law(np.array([*TRUE_LAW.values()]), GEOMETRY)
    return LawMotion(law, GEOMETRY, SlipVariation(*plan.knowledge.slip))


def drive_plan(number: int, plan: DrivePlan) -> tuple[dict[str, Estimate], float, float]:
    """Estimates; reach from the middle of the area and largest speed of a belt, of what is allowed
    [-].
    """
    rng = generator(0, f"trial {number} of plan")
    counts = Drive().encoder_counts
    readings = np.concatenate([plan.omega[:1], plan.omega[:-1]])  # means since the row before
    log, motion = driven_by_law("plan", law_motion(plan), readings, RATE, rng, plan.start, counts)
    measured = joined_log(log, *SLAM.measure(motion, rng))
    estimates = identified([measured], GEOMETRY)

    reach = np.abs(motion.pose[:, :2]) / (plan.limits.room / 2)
    resolution = 2 * np.pi / counts * RATE
    fastest = np.abs(log.omega).max() - resolution
    speed = fastest * GEOMETRY.sprocket_radius / plan.limits.max_speed
    return estimates, float(reach.max()), float(speed)


def drive_paper_runs(number: int, plan: DrivePlan) -> dict[str, Estimate]:
    rng = generator(0, f"trial {number} of paper")
    counts = Drive().encoder_counts
    rows = round(PAPER_DURATION * PAPER_RATE) + 1
    law = law_motion(plan)
    drives = []
    for k, belts in enumerate(np.array(paper_runs(GEOMETRY))):
        omega = np.tile(belts / GEOMETRY.sprocket_radius, (rows, 1))
        drives.append(driven_by_law(f"circle {k}", law, omega, PAPER_RATE, rng, counts=counts))
    logs = [joined_log(log, *SLAM.measure(motion, rng)) for log, motion in drives]
    return identified(logs, GEOMETRY)
