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
PLANNED, PAPER = 400, 100
"""Drives of the plan by the law, and repeats of the paper's 25 runs."""
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
    return plan_drive(GEOMETRY, DriveLimits(0.3, 0.5, (3.0, 3.0), duration, 0.0), poses, LAW)


def test_a_plan_and_the_papers_runs_by_a_law():
    plan = planned(120.0)
    driven = outcomes(partial(drive_plan, plan=plan), range(PLANNED))
    estimates = {"plan": [trial for trial, *_ in driven]}
    estimates["paper"] = outcomes(partial(drive_paper_runs, plan=plan), range(PAPER))
    paper = expected_of_paper(plan)
    assert paper is not None
    predicted = {"plan": plan.expectation.stderr, "paper": paper.stderr}
    real = {
        case: {
            name: Estimates.of(trials, name).rms_error(value) for name, value in TRUE_LAW.items()
        }
        for case, trials in estimates.items()
    }
    rows = []
    for name in TRUE_LAW:
        factor, unit = unit_of(LAW, name)
        cells = [
            significant(factor * errors[case][name], unit, 3)
            for case in real
            for errors in (predicted, real)
        ]
        rows.append((symbol(LAW, name), *cells))
    header = ("parameter", "plan predicted", "real", "paper's runs predicted", "real")
    print()
    Table(f"{PLANNED} drives of the plan, {PAPER} times the paper's runs", header, rows).print()
    failed = sum(not trial for trials in estimates.values() for trial in trials)
    case = f"{PLANNED} drives of {plan.limits.duration:g} s"
    reach, speed = np.max([used for _, *used in driven], axis=0)
    checks = [
        Check(case, "fits that failed", float(failed), 0.0),
        Check(case, "farthest from the middle, of what the area allows", float(reach), ROUNDING),
        Check(case, "largest speed, of what is allowed", float(speed), ROUNDING),
    ]
    for name, most in OVER_PAPER.items():
        over = real["plan"][name] / predicted["plan"][name]
        checks.append(Check(case, f"real over predicted error of {name}", over, AGREEMENT))
        over = real["plan"][name] / predicted["paper"][name]
        checks.append(
            Check(case, f"error of {name} over that predicted for the paper's runs", over, most)
        )
    report("The plan and the paper's runs", checks)


def law_motion(plan: DrivePlan) -> LawMotion:
    law = FAMILIES[LAW].law(np.array([*TRUE_LAW.values()]), GEOMETRY)
    return LawMotion(law, GEOMETRY, SlipVariation(*plan.knowledge.slip))


def drive_plan(number: int, plan: DrivePlan) -> tuple[dict[str, Estimate], float, float]:
    """Estimates; reach from the middle of the area and largest speed of a belt, of what is allowed
    [-].
    """
    rng, counts = generator(0, f"trial {number} of plan"), Drive().encoder_counts
    readings = np.concatenate([plan.omega[:1], plan.omega[:-1]])  # means since the row before
    log, motion = driven_by_law("plan", law_motion(plan), readings, RATE, rng, plan.start, counts)
    estimates = identified([joined_log(log, *SLAM.measure(motion, rng))], GEOMETRY)
    reach = float((np.abs(motion.pose[:, :2]) / (plan.limits.room / 2)).max())
    resolution = 2 * np.pi / counts * RATE
    speed = (np.abs(log.omega).max() - resolution) * GEOMETRY.sprocket_radius
    return estimates, reach, float(speed / plan.limits.max_speed)


def drive_paper_runs(number: int, plan: DrivePlan) -> dict[str, Estimate]:
    rng, counts = generator(0, f"trial {number} of paper"), Drive().encoder_counts
    rows = round(PAPER_DURATION * PAPER_RATE) + 1
    drives = [
        driven_by_law(
            f"circle {k}",
            law_motion(plan),
            np.tile(omega, (rows, 1)),
            PAPER_RATE,
            rng,
            counts=counts,
        )
        for k, omega in enumerate(np.array(paper_runs(GEOMETRY)) / GEOMETRY.sprocket_radius)
    ]
    return identified(
        [joined_log(log, *SLAM.measure(motion, rng)) for log, motion in drives], GEOMETRY
    )
