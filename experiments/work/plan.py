"""`trackslip plan`: the shortest experiment, and how well it does."""

import csv
import math
import shlex
import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.options.plan import PlanConfig
from experiments.parallel.executors import workers
from experiments.parallel.workers import processors
from experiments.report.plan import EXPECTED_HEADER, expected_rows
from experiments.report.terminal import print_table, progress
from experiments.storage.manifest import make_manifest
from experiments.storage.results import BAGS_FOLDER, FIGURES_FOLDER, results_folder, write_results
from sim.wander.pose_source import SOURCES, PoseSource
from trackslip.errors import InvalidValueError
from trackslip.kinematics import RobotGeometry
from trackslip.planning.after import Before, read_identification
from trackslip.planning.information import Expectation, PoseQuality
from trackslip.planning.limits import Knowledge, first_knowledge
from trackslip.planning.plan import DrivePlan, evaluations, expected_of_paper, plan_drive
from trackslip.ros.decode import has_rosbags

if TYPE_CHECKING:
    from experiments.studies.plan_trials import Trials

PLAN_FILE = "plan.csv"
BAG_FILE = "cmd_vel.mcap"
_COLUMNS = ("t", "omega_l", "omega_r", "v", "w")


def run(config: PlanConfig) -> None:
    """Plan, try, store and print."""
    began = time.perf_counter()
    bag = config.bag and has_rosbags()
    with results_folder(config.out) as folder:
        plan = planned(config)
        paper = expected_of_paper(plan)
        trials = _tried(config, plan, paper) if config.drive else None
        write_plan(folder / PLAN_FILE, plan)
        _draw(plan, folder, config.pdf)
        if bag:
            from trackslip.ros.command_bag import write_commands  # late: few need it

            write_commands(folder / BAGS_FOLDER / BAG_FILE, plan.time, plan.twist)
        wall = time.perf_counter() - began
        summary = plan_to_json(plan, paper) | ({"trials": trials.to_json()} if trials else {})
        checks = {"checks": [check.to_json() for check in trials.checks()]} if trials else {}
        timing = {"timing": {"wall_s": wall, "stages": {"plan": wall}}}
        first = trials.log if trials else None
        manifest = make_manifest("plan", config, wall, seed=config.seed)
        write_results(folder, summary | checks | timing, manifest, [] if first is None else [first])
    _print(plan, paper, trials)
    print(f"{config.out / PLAN_FILE}: {wall:.1f} s")
    if bag:
        print(f"{config.out / BAGS_FOLDER / BAG_FILE}: commands as a ROS 2 bag")
    elif config.bag:
        print("no ROS 2 bag of the commands: that needs the package rosbags, pip install 'trackslip[ros]'")
    print(f"next: drive it, then trackslip identify LOG{_sizes(plan)}")


def planned(config: PlanConfig) -> DrivePlan:
    """The plan that the options ask for; raises LogError for results that can't be read, InvalidValueError."""
    before = None if config.after is None else read_identification(config.after, config.law)
    geometry = _geometry(config, before)
    limits = config.limits()
    with progress("drives", evaluations(limits, config.law), "drives") as step:
        return plan_drive(
            geometry,
            limits,
            _quality(SOURCES[config.poses]),
            config.law,
            _knowledge(config, geometry, before),
            None if before is None else before.values,
            None if before is None else before.known,
            config.seed,
            step,
        )


def write_plan(file: Path, plan: DrivePlan) -> None:
    """Write the commands as CSV: times [s], sprocket speeds [rad/s], and the twists [m/s, rad/s] that they mean."""
    rows = np.column_stack([plan.time, plan.omega, plan.twist])
    with file.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(_COLUMNS)
        writer.writerows([[f"{value:.6g}" for value in row] for row in rows])


def plan_to_json(plan: DrivePlan, paper: Expectation | None) -> dict[str, Any]:
    """What summary.json says of a plan, in SI units."""
    names = list(plan.sizes)
    knowledge = asdict(plan.knowledge)
    return {
        "law": plan.law,
        "values": dict(zip(names, plan.values.tolist(), strict=True)),
        "geometry": knowledge.pop("geometry"),
        "limits": asdict(plan.limits),
        "knowledge": knowledge,
        "poses": asdict(plan.poses),
        "relative_to": plan.sizes,
        "stderr": dict(plan.expectation.stderr),
        "held": list(plan.expectation.held),
        "paper_stderr": None if paper is None else dict(paper.stderr),
        "start": plan.start.tolist(),
        "places": {"low": plan.places.low.tolist(), "high": plan.places.high.tolist()},
        "strokes": {"way": plan.strokes.way.tolist(), "duration": plan.strokes.duration.tolist()},
    }


def _quality(source: PoseSource) -> PoseQuality:
    """What a plan has to know of a source of poses."""
    return PoseQuality(source.rate, source.position_noise, source.heading_noise if source.heading else None)


def _geometry(config: PlanConfig, before: Before | None) -> RobotGeometry:
    """That given; raises InvalidValueError if the identification before was of another robot."""
    if before is None:
        assert config.half_gauge is not None
        assert config.sprocket_radius is not None
        return RobotGeometry(config.half_gauge, config.sprocket_radius)
    for name in ("half_gauge", "sprocket_radius"):
        given, stored = getattr(config, name), getattr(before.geometry, name)
        if given is not None and not math.isclose(given, stored, rel_tol=1e-6):
            raise InvalidValueError(name, given, f"that of {config.after}, {stored:g} m, or left out")
    return before.geometry


def _knowledge(config: PlanConfig, geometry: RobotGeometry, before: Before | None) -> Knowledge:
    """What is known of the robot, with what the options say."""
    knowledge = first_knowledge(geometry) if before is None else before.knowledge
    return replace(
        knowledge,
        offset=knowledge.offset if config.offset is None else config.offset,
        reach_doubt=knowledge.reach_doubt if config.doubt is None else config.doubt,
    )


def _tried(config: PlanConfig, plan: DrivePlan, paper: Expectation | None) -> "Trials":
    from experiments.studies.plan_trials import DRIVES, try_plan  # late: plans need none of it

    jobs = config.threads or processors()
    simulated = None
    if config.motion == "mujoco":
        from experiments.driving.plan import driven_in_mujoco  # late, too: MuJoCo

        with progress("drives in MuJoCo", plan.limits.duration + 90.0) as report:
            simulated = driven_in_mujoco(plan, config.seed, config.threads, report)
    executor = "processes" if min(jobs, config.repeats) > 1 else "inline"
    count = config.repeats * (2 if simulated else 1 + DRIVES)
    with progress("trials", count, "trials") as step, workers(executor, jobs) as pool:
        return try_plan(plan, paper, SOURCES[config.poses], config.repeats, config.seed, simulated, pool, step)


def _draw(plan: DrivePlan, folder: Path, pdf: bool) -> None:
    from experiments.report.figures.plan import draw_plan  # late: matplotlib

    figures = folder / FIGURES_FOLDER
    figures.mkdir()
    figure = draw_plan(plan)
    for ending in ("svg", *(["pdf"] if pdf else [])):
        figure.savefig(figures / f"plan.{ending}")


def _print(plan: DrivePlan, paper: Expectation | None, trials: "Trials | None") -> None:
    limits = plan.limits
    title = f"{limits.duration:g} s in {limits.area_text} m: what {plan.law} will be known to"
    print_table(title, EXPECTED_HEADER, expected_rows(plan, paper))
    x, y, heading = plan.start
    print(f"start at x = {x:.2f} m, y = {y:.2f} m from the middle of the area, heading {math.degrees(heading):.0f} deg")
    across, up = plan.places.size
    print(
        f"the middle of the robot stays within {across:.2f} x {up:.2f} m while half_gauge + D is "
        f"{plan.knowledge.reach:.3f} m within {plan.knowledge.reach_doubt:.0%}"
    )
    held = [name for name in plan.expectation.held if name not in ("lag", "sensor_yaw")]
    if held:
        print(f"not determined by it: {', '.join(held)}")
    if trials is not None:
        _print_trials(trials)


def _print_trials(trials: "Trials") -> None:
    from experiments.report.drive_checks import CHECKS_HEADER, checks_table  # late, as above
    from experiments.report.plan_trials import TRIED_HEADER, tried_rows
    from experiments.report.studies import print_failures
    from experiments.studies.plan_trials import PAPER, PLAN, sampling_error

    checks = trials.checks()
    if trials.simulated:
        title = f"A drive in MuJoCo, measured {trials.repeats} times: standard deviations between measurements"
    else:
        driven = f"{len(trials.of(PLAN))} drives of the plan, {trials.repeats} times the paper's runs"
        title = f"{driven}, moved by the law: root mean square errors"
    print_table(title, TRIED_HEADER, tried_rows(trials))
    if not trials.simulated:
        counts = {source: len(trials.of(source)) for source in (PLAN, PAPER)}
        known = [f"{source} {sampling_error(count):.0%}" for source, count in counts.items() if count]
        print(f"so many drives leave real errors uncertain by: {', '.join(known)}")
    print_table("Checks", CHECKS_HEADER, checks_table(checks))
    print_failures(trials.failures, checks)


def _sizes(plan: DrivePlan) -> str:
    geometry = plan.knowledge.geometry
    return f" --half-gauge {shlex.quote(f'{geometry.half_gauge:g}')} --sprocket-radius {geometry.sprocket_radius:g}"
