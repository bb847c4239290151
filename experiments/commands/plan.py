"""`trackslip plan`: the shortest experiment to identify a slip law from, and trials of it."""

import re
import shlex
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import tyro

from experiments.options.base import Exclusion, Needs, Positive, Whole, Within, default_is
from experiments.options.world import Repeatable
from trackslip.errors import InvalidValueError
from trackslip.planning.limits import DriveLimits
from trackslip.ros.choice import require_topic

EXAMPLES = (
    ("the best minute in 3 x 3 m", "trackslip plan --half-gauge 0.168 --sprocket-radius 0.06"),
    ("outdoors, with GNSS", "trackslip plan --half-gauge 0.3 --sprocket-radius 0.1 --area 12x8 --poses gnss"),
    ("where the law is least known", "trackslip plan --after out/identify --duration 30"),
    ("simulated a hundred times", "trackslip plan --after out/identify --drive --repeats 100"),
)
PLAN_FILE = "plan.csv"
BAG_FILE = "cmd_vel.mcap"
_AREA = re.compile(r"(\d+(?:\.\d*)?|\.\d+)x(\d+(?:\.\d*)?|\.\d+)")
_OF_AFTER = default_is("from --after", "FLOAT")


@dataclass(frozen=True)
class Config(Repeatable):
    """Plan the shortest experiment: a drive within limits that determines a slip law as well as possible."""

    half_gauge: Annotated[float | None, Positive(10.0, "m"), _OF_AFTER] = None
    """Half the distance between the tracks [m]."""
    sprocket_radius: Annotated[float | None, Positive(10.0, "m"), _OF_AFTER] = None
    """Radius of the sprockets [m]."""
    max_speed: float = 0.3
    """Largest speed of a belt [m/s]."""
    acceleration: float = 0.5
    """Largest acceleration of a belt [m/s^2]."""
    area: Annotated[str, tyro.conf.arg(metavar="LENGTHxWIDTH")] = "3x3"
    """Area that the middle of the robot may not leave, in metres."""
    clearance: float = 0.0
    """Distance that the middle of the robot keeps from the area's edge, such as half the robot's diagonal [m]."""
    duration: float = 60.0
    """Length of the drive [s]."""
    poses: Literal["slam", "mocap", "gnss", "scanner"] = "slam"
    """Source of the poses: SLAM, motion capture, GNSS (no headings), or a stationary scanner."""
    law: Literal["icr", "icr_radius", "icr_sides", "turn_loss", "turn_loss_sides", "exponential"] = "icr_radius"
    """Slip law to identify."""
    offset: Annotated[float | None, default_is("from --after, else 0.3 half gauges", "FLOAT")] = None
    """Expected D: distance of the ICRs (instantaneous centres of rotation) outside the tracks [m]."""
    doubt: Annotated[float | None, Within(0, 0.9), default_is("from --after, else 0.15", "FLOAT")] = None
    """Relative error of half gauge + D at which the robot still stays within the area [-]."""
    after: Annotated[Path | None, default_is("none", "FOLDER")] = None
    """Results of identify to go on from: the drive targets what they left uncertain."""
    drive: bool = False
    """Also drive it, and the paper's 25 runs, identify the law from each, and compare the errors."""
    repeats: Annotated[int, Whole(1, 10_000)] = 1
    """Number of trials, each with its own noise; with --motion mujoco, all measure the same drives. Needs --drive."""
    motion: Literal["law", "mujoco"] = "law"
    """Model that moves the robot with --drive: a law with random slip, or the simulated ground."""
    bag: bool = True
    """Also write the commands as a ROS 2 bag to OUT/bags, if the package rosbags is installed."""
    topic: str = "/cmd_vel"
    """Topic of the commands in the bag, such as a controller's: /diff_drive_controller/cmd_vel."""
    pdf: bool = False
    """Also write the figure as PDF."""
    out: Path = Path("out/plan")
    """Folder for the results."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (Needs(("repeats", "motion"), "drive"),)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("half_gauge", "sprocket_radius"):
            if self.after is None and getattr(self, name) is None:
                raise InvalidValueError(name, None, f"given (--{name.replace('_', '-')} on the command line)")
        require_topic(self.topic)
        self.limits()

    def limits(self) -> DriveLimits:
        """Limits of the drive."""
        sides = _AREA.fullmatch(self.area.strip().lower())
        if sides is None:
            raise InvalidValueError("area", self.area, "length x width in metres, such as 3x3 or 4.5x2")
        area = (float(sides[1]), float(sides[2]))
        return DriveLimits(self.max_speed, self.acceleration, area, self.duration, self.clearance)


def run(config: Config) -> None:
    """Plan, try, store and print."""
    from experiments.driving.plan import plan_to_json, planned, write_plan
    from experiments.report.plan import page, print_plan
    from experiments.run import Run
    from experiments.storage.results import BAGS_FOLDER, REPORT_FILE
    from experiments.studies.plan_trials import try_plan
    from experiments.studies.trials import forget_trials
    from trackslip.planning.plan import expected_of_paper
    from trackslip.ros.messages import has_rosbags
    from trackslip.ros.writer import write_commands

    bag = config.bag and has_rosbags()
    with Run(config, partial(forget_trials, config.out)) as run:
        plan = planned(config, run)
        paper = expected_of_paper(plan)
        summary, logs = plan_to_json(plan, paper), []
        if config.drive:
            study, log = try_plan(config, plan, paper, run)
            trials = study.to_json()
            summary |= {"trials": trials, "checks": trials["checks"]}
            logs = [log]
        write_plan(run.folder / PLAN_FILE, plan)
        manifest = run.manifest(seed=config.seed)
        page(plan, paper, manifest, study.shown if config.drive else ()).write(run.folder, config.pdf)
        if bag:
            write_commands(run.folder / BAGS_FOLDER / BAG_FILE, plan.time, plan.twist, config.topic)
        run.write(summary, logs, manifest=manifest)
    print_plan(plan, paper)
    if config.drive:
        study.print()
    print(f"{config.out / PLAN_FILE}, {REPORT_FILE}: {run.wall:.1f} s")
    if bag:
        place = config.out / BAGS_FOLDER / BAG_FILE
        print(f"{place}: commands on {config.topic}; send them with ros2 bag play {shlex.quote(str(place))}")
    elif config.bag:
        print("no ROS 2 bag of the commands, as the package rosbags is missing: pip install 'trackslip[ros]'")
    robot = plan.knowledge.geometry
    sizes = f"--half-gauge {shlex.quote(f'{robot.half_gauge:g}')} --sprocket-radius {robot.sprocket_radius:g}"
    print(f"next: drive it, then trackslip identify LOG {sizes}")
