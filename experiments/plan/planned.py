"""Plans of drives as the options ask for them, and as files."""

from __future__ import annotations

import csv
import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.common.run import Run
from experiments.plan.config import Config
from sim.wander.pose_source import SOURCES
from trackslip.errors import InvalidValueError
from trackslip.kinematics import RobotGeometry
from trackslip.planning.information import Expectation, PoseQuality
from trackslip.planning.limits import first_knowledge
from trackslip.planning.plan import DrivePlan, evaluations, plan_drive
from trackslip.planning.prior import PriorIdentification, read_identification

_COLUMNS = ("t", "omega_l", "omega_r", "v", "w")


def planned(config: Config, run: Run) -> DrivePlan:
    """The plan that the options ask for; raises LogError for results that can't be read, InvalidValueError."""
    before = None if config.after is None else read_identification(config.after, config.law)
    geometry = _geometry(config, before)
    knowledge = first_knowledge(geometry) if before is None else before.knowledge
    knowledge = replace(
        knowledge,
        offset=knowledge.offset if config.offset is None else config.offset,
        reach_doubt=knowledge.reach_doubt if config.doubt is None else config.doubt,
    )
    source, limits = SOURCES[config.poses], config.limits()
    poses = PoseQuality(source.rate, source.position_noise, source.heading_noise if source.heading else None)
    values, known = (None, None) if before is None else (before.values, before.known)
    with run.progress("drives", evaluations(limits), "drives") as step:
        return plan_drive(geometry, limits, poses, config.law, knowledge, values, known, config.seed, step)


def _geometry(config: Config, before: PriorIdentification | None) -> RobotGeometry:
    """The robot's geometry; raises InvalidValueError if the identification before was of another robot."""
    if before is None:
        assert config.half_gauge is not None
        assert config.sprocket_radius is not None
        return RobotGeometry(config.half_gauge, config.sprocket_radius)
    for name in ("half_gauge", "sprocket_radius"):
        given, stored = getattr(config, name), getattr(before.geometry, name)
        if given is not None and not math.isclose(given, stored, rel_tol=1e-6):
            raise InvalidValueError(name, given, f"that of {config.after}, {stored:g} m, or left out")
    return before.geometry


def write_plan(file: Path, plan: DrivePlan) -> None:
    """Write the commands as CSV: times [s], sprocket speeds [rad/s], and the twists [m/s, rad/s] that they mean."""
    rows = np.column_stack([plan.time, plan.omega, plan.twist])
    with file.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(_COLUMNS)
        writer.writerows([[f"{value:.6g}" for value in row] for row in rows])


def plan_to_json(plan: DrivePlan, paper: Expectation | None) -> dict[str, Any]:
    """The content of summary.json on a plan, in SI units."""
    knowledge = asdict(plan.knowledge)
    return {
        "law": plan.law,
        "values": dict(zip(plan.sizes, plan.values.tolist(), strict=True)),
        "geometry": knowledge.pop("geometry"),
        "limits": plan.limits,
        "knowledge": knowledge,
        "poses": plan.poses,
        "relative_to": plan.sizes,
        "stderr": plan.expectation.stderr,
        "held": plan.expectation.held,
        "paper_stderr": None if paper is None else paper.stderr,
        "start": plan.start,
        "places": {"low": plan.places.low, "high": plan.places.high},
        "strokes": {"way": plan.maneuvers.way, "duration": plan.maneuvers.duration},
    }
