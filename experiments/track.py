"""`trackslip track`: follow a path once in closed loop."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal

import numpy as np
import tyro

from experiments.common.choices import COMPENSATIONS, CONTROLLERS, REFERENCES, WITHOUT_LAWS
from experiments.common.lookup import compensation, reference
from experiments.common.options import Excludes, Exclusion, Needs, Within, default_is
from experiments.common.plain_json import plain
from experiments.common.results import RUNS_FILE, bags_text, write_bags
from experiments.common.run import Run
from experiments.recorder import record_all
from experiments.simulate import options
from experiments.simulate.closed_loop import ClosedLoopRun, drive_closed_loops
from experiments.simulate.grid_runs import before_scanner
from experiments.simulate.grid_summary import (
    LocalizationErrors,
    saturation_warnings,
    simulated_seconds,
    soil_warnings,
)
from experiments.simulate.motors import print_motors
from experiments.simulate.tracking import tracking_results, tracking_table
from experiments.simulate.world import World
from sim.motors.motor import Drive
from trackslip.bags.open import require_rosbags
from trackslip.trajectory.base import Reference
from trackslip.trajectory.segmented import circle

EXAMPLES: Final = (
    ("the paper's path and controller", "trackslip track"),
    ("without slip compensation", "trackslip track --compensation none --out out/track-none"),
    (
        "with online identification",
        "trackslip track --controller lqr --compensation online --reference slalom",
    ),
    ("with your own laws", "trackslip track --laws out/identify --compensation exponential"),
)


@dataclass(frozen=True)
class Config(options.Simulation):
    """Follow a path once in closed loop, localizing with the scanner, and print the errors."""

    controller: Annotated[str, tyro.conf.arg(metavar=CONTROLLERS)] = "linear"
    """Controller, such as linear:stiffness=160 (the paper's Eq. 31), ppo:FOLDER from train, or your
    MODULE:CLASS.
    """
    compensation: Annotated[str, tyro.conf.arg(metavar=COMPENSATIONS)] = "icr_radius"
    """A LAW in --laws; online starts from icr_radius, online_load from icr_load in --laws,
    online_cold from no slip.
    """
    preview: Annotated[float, Within(0, options.MAX_PREVIEW, "s")] = 0.0
    """Time by which controllers look ahead on the path; 0.075 s compensates for the lag of servo
    and sampling [s].
    """
    localization: Literal["plate", "line", "truth"] = "plate"
    """Source of the controller's poses: scans, by the plate or line method, or the true pose
    (truth).
    """
    reference: Annotated[str, tyro.conf.arg(metavar=REFERENCES)] = "paper"
    """Path: the paper's takes 45.8 s, circle is in front of the scanner, a .csv file has waypoints
    x,y[,yaw][,v].
    """
    circle_radius: Annotated[float, Within(0.1, options.MAX_RADIUS, "m")] = 1.25
    """Radius of the circle, which turns left; needs --reference circle [m]."""
    circle_speed: float = 0.15
    """Speed on the circle; needs --reference circle [m/s]."""
    circle_duration: Annotated[float, Within(1.0, options.MAX_DURATION, "s")] = 45.0
    """Time on the circle; needs --reference circle [s]."""
    start: Annotated[
        tuple[float, float, float] | None,
        Within(-options.MAX_COORDINATE, options.MAX_COORDINATE),
        default_is("that of the path", "X Y PHI"),
    ] = None
    """Start pose; the paper's linear controller starts at 0.3 -0.2 1.0472 [m, m, rad]."""
    laws: Annotated[Path | None, default_is("the laws shipped with trackslip", "PATH")] = None
    """Identified laws: a summary.json, or a folder that contains one."""
    bag: bool = False
    """Also write a ROS 2 bag to OUT/bags."""
    out: Path = Path("out/track")
    """Folder for the results."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Needs(("circle_radius", "circle_speed", "circle_duration"), "reference", ("circle",)),
        Excludes(("laws",), "compensation", WITHOUT_LAWS),
        options.WITHOUT_SCANS,
    )

    def check(self, drive: Drive) -> None:
        """Raise InvalidValueError for options that the robot's drive does not allow."""
        super().check(drive)
        if self.reference == "circle":
            options.require_speed("circle_speed", self.circle_speed, drive.top_speed)


def run(config: Config) -> None:
    """Drive the path once, store the run, and print its errors."""
    if config.bag:
        require_rosbags()
    world = World.of(config)
    names = (config.controller, config.compensation)
    name = " ".join(names)
    metadata: dict[str, Any] = {"reference": config.reference}
    if config.reference == "circle":
        shape = {
            "radius": config.circle_radius,
            "speed": config.circle_speed,
            "duration": config.circle_duration,
        }
        metadata["circle"] = plain({**shape, "start": before_scanner(world.robot)})
        path: Reference = circle(**shape, start=before_scanner(world.robot))
    else:
        path = reference(config.reference)
    start = path.pose(0.0) if config.start is None else np.array(config.start)
    case = ClosedLoopRun(name, f"track {name}", config.seed, *names, start, metadata=metadata)
    law = partial(compensation, robot=world.robot.geometry, laws=config.laws)
    with Run(config) as run:
        with run.progress(name, path.duration) as report:
            logs = drive_closed_loops(
                [case], world, path, config.localization, law, config.preview, report, config.bag
            )
        results = tracking_results(logs, path)
        poses = LocalizationErrors.of(logs)
        summary: dict[str, Any] = {
            "tracking": [result.to_json() for result in results],
            "localization": poses,
        }
        if config.bag:
            summary["bags"] = write_bags(run.folder, [log.run for log in logs], logs)
        run.write(summary, logs, simulated_seconds(logs), **world.about)
        if config.rrd:
            with run.busy("recording"):
                record_all(run.folder, logs)
    tracking_table(results).print()
    for warning in [*saturation_warnings(logs), *soil_warnings(logs)]:
        print(f"Warning: {warning}.")
    print_motors(config.robot, world.drive)
    bridged = "; odometry bridged the rest" if poses.valid_fraction < 1 else ""
    print(f"{poses.valid_fraction:.1%} of the scans gave a valid pose{bridged}")
    if config.bag:
        print(bags_text(config.out, summary["bags"]))
    print(f"{config.out / RUNS_FILE}: {run.wall:.1f} s")
