"""`trackslip plan`: design the shortest experiment that identifies a slip law."""

import shlex
from dataclasses import asdict, replace
from typing import Any, Final

import numpy as np

from experiments.common.results import BAGS_FOLDER, REPORT_FILE
from experiments.common.run import Run
from experiments.plan.config import Config
from experiments.plan.page import page, print_plan
from sim.bags.writer import write_commands
from sim.wander.pose_sensor import POSE_SENSORS
from trackslip.bags.open import has_rosbags
from trackslip.identification.comparison import REFERENCE
from trackslip.laws.families import FAMILIES
from trackslip.planning.information import Expectation, PoseQuality
from trackslip.planning.limits import first_knowledge, read_identification
from trackslip.planning.plan import DrivePlan, evaluations, expected_of_paper, plan_drive

PLAN_FILE: Final = "plan.csv"
BAG_FILE: Final = "cmd_vel.mcap"


def run(config: Config) -> None:
    """Plan a drive, and store and print the plan."""
    bag = config.bag and has_rosbags()
    bag_file = config.out / BAGS_FOLDER / BAG_FILE
    with Run(config) as run:
        plan = _plan(config, run)
        paper = expected_of_paper(plan)
        robot = plan.knowledge.geometry
        play = f"ros2 bag play {shlex.quote(str(bag_file))}"
        sizes = f"--half-gauge {robot.half_gauge:g} --sprocket-radius {robot.sprocket_radius:g}"
        identify = f"trackslip identify LOG {sizes}"
        rows = np.column_stack([plan.time, plan.omega, plan.twist])
        header = "t,omega_l,omega_r,v,w"
        np.savetxt(run.folder / PLAN_FILE, rows, "%.6g", ",", header=header, comments="")
        manifest = run.manifest(seed=config.seed)
        steps = [play, identify] if bag else [identify]
        page(plan, paper, manifest, steps).write(run.folder, config.pdf)
        if bag:
            write_commands(run.folder / BAGS_FOLDER / BAG_FILE, plan.time, plan.twist, config.topic)
        run.write(_to_json(plan, paper), manifest=manifest)
    print_plan(plan, paper)
    print(f"{config.out / PLAN_FILE}, {REPORT_FILE}: {run.wall:.1f} s")
    if bag:
        print(f"{bag_file}: commands on {config.topic}; send them with {play}")
    elif config.bag:
        print(
            "no ROS 2 bag of the commands, as the package rosbags is missing: pip install -e "
            '".[ros]"'
        )
    print(f"next: drive it, then {identify}")


def _plan(config: Config, run: Run) -> DrivePlan:
    """The plan for the options; raises LogError for unreadable results, InvalidValueError for
    invalid options.
    """
    law: str = config.law or REFERENCE
    if config.after is None:
        geometry = config.geometry()
        knowledge = first_knowledge(geometry)
        values = None
        known = None
    else:
        before, knowledge = read_identification(config.after, config.law)
        geometry = before.geometry
        law = before.name
        known = before.errors
        values = [getattr(before.law, name) for name in FAMILIES[law].names]
    if config.offset is not None:
        knowledge = replace(knowledge, offset=config.offset)
    if config.doubt is not None:
        knowledge = replace(knowledge, reach_doubt=config.doubt)
    limits = config.limits(geometry)
    source = POSE_SENSORS[config.poses]
    heading_noise = source.heading_noise if source.heading else None
    poses = PoseQuality(source.rate, source.position_noise, heading_noise)
    with run.progress("drives", evaluations(limits), "drives") as step:
        return plan_drive(geometry, limits, poses, law, knowledge, values, known, config.seed, step)


def _to_json(plan: DrivePlan, paper: Expectation | None) -> dict[str, Any]:
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
        "held": plan.expectation.undetermined,
        "paper_stderr": None if paper is None else paper.stderr,
        "start": plan.start,
        "places": {"low": plan.places[0], "high": plan.places[1]},
        "strokes": {"way": plan.maneuvers.distance, "duration": plan.maneuvers.duration},
    }
