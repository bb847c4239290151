"""`trackslip plan`: the shortest experiment to identify a slip law from."""

import shlex

from experiments.common.results import BAGS_FOLDER, REPORT_FILE
from experiments.common.run import Run
from experiments.plan.config import BAG_FILE, PLAN_FILE, Config
from experiments.plan.page import page, print_plan
from experiments.plan.planned import plan_to_json, planned, write_plan
from trackslip.planning.plan import expected_of_paper
from trackslip.ros.messages import has_rosbags
from trackslip.ros.writer import write_commands


def run(config: Config) -> None:
    """Plan, store and print."""
    bag = config.bag and has_rosbags()
    with Run(config) as run:
        plan = planned(config, run)
        paper = expected_of_paper(plan)
        write_plan(run.folder / PLAN_FILE, plan)
        manifest = run.manifest(seed=config.seed)
        page(plan, paper, manifest, ()).write(run.folder, config.pdf)
        if bag:
            write_commands(run.folder / BAGS_FOLDER / BAG_FILE, plan.time, plan.twist, config.topic)
        run.write(plan_to_json(plan, paper), manifest=manifest)
    print_plan(plan, paper)
    print(f"{config.out / PLAN_FILE}, {REPORT_FILE}: {run.wall:.1f} s")
    if bag:
        place = config.out / BAGS_FOLDER / BAG_FILE
        print(f"{place}: commands on {config.topic}; send them with ros2 bag play {shlex.quote(str(place))}")
    elif config.bag:
        print("no ROS 2 bag of the commands, as the package rosbags is missing: pip install 'trackslip[ros]'")
    robot = plan.knowledge.geometry
    sizes = f"--half-gauge {shlex.quote(f'{robot.half_gauge:g}')} --sprocket-radius {robot.sprocket_radius:g}"
    print(f"next: drive it, then trackslip identify LOG {sizes}")
