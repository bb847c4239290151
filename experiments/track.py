"""`trackslip track`: follow a path once in closed loop."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final

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
from experiments.simulate.closed_loop import ClosedLoopRun, Loop, drive_closed_loops
from experiments.simulate.grid_runs import before_scanner
from experiments.simulate.grid_summary import (
    LocalizationErrors,
    saturation_warnings,
    simulated_seconds,
)
from experiments.simulate.motors import print_motors
from experiments.simulate.tracking import tracking_results, tracking_table
from experiments.simulate.world import World
from sim.motors.motor import Drive
from sim.runs.stopwatch import StepTimes, Stopwatch
from trackslip.bags.open import require_rosbags
from trackslip.errors import InvalidValueError
from trackslip.online.compensation import Compensation
from trackslip.trajectory.base import Reference
from trackslip.trajectory.drivable import Demand, require_drivable
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
class Config(options.Simulation, options.ClosedLoopOptions):
    """Follow a path once in closed loop, localizing with the scanner, and print the errors."""

    controller: Annotated[str, tyro.conf.arg(metavar=CONTROLLERS)] = "linear"
    """Controller, such as linear:stiffness=160 (the paper's Eq. 31), ppo:FOLDER from train, or your
    MODULE:CLASS.
    """
    compensation: Annotated[str, tyro.conf.arg(metavar=COMPENSATIONS)] = "icr_radius"
    """A LAW in --laws; online starts from icr_radius, online_load from icr_load in --laws,
    online_cold from no slip.
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
    bag: bool = False
    """Also write a ROS 2 bag to OUT/bags."""
    out: Path = Path("out/track")
    """Folder for the results."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Needs(("circle_radius", "circle_speed", "circle_duration"), "reference", ("circle",)),
        Excludes(("laws",), "compensation", WITHOUT_LAWS),
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
    law = partial(compensation, robot=world.robot.geometry, laws=config.laws)
    _require_drivable(config, path, law(config.compensation), world)
    start = path.pose(0.0) if config.start is None else np.array(config.start)
    case = ClosedLoopRun(name, f"track {name}", config.seed, *names, start, metadata=metadata)
    watch = Stopwatch()
    with Run(config) as run:
        with run.progress(name, path.duration) as report:
            logs = drive_closed_loops(
                [case], world, path, Loop.of(config), law, report, config.bag, watch
            )
        results = tracking_results(logs, path)
        poses = LocalizationErrors.of(logs)
        steps = StepTimes.of(watch.steps[name])
        summary: dict[str, Any] = {
            "tracking": [result.to_json() for result in results],
            "localization": poses,
            "timing": {
                "step_s": steps.median,
                "p99_step_s": steps.p99,
                "worst_step_s": steps.worst,
            },
        }
        if config.bag:
            summary["bags"] = write_bags(run.folder, [log.run for log in logs], logs)
        run.write(summary, logs, simulated_seconds(logs), **world.about)
        if config.rrd:
            with run.busy("recording"):
                record_all(run.folder, logs)
    tracking_table(results).print()
    late = steps.warning(config.controller, config.scanner.period)
    for warning in [*saturation_warnings(logs), *([late] if late else [])]:
        print(f"Warning: {warning}.")
    print_motors(config.robot, world.drive)
    bridged = "; odometry bridged the rest" if poses.valid_fraction < 1 else ""
    print(f"{poses.valid_fraction:.1%} of the scans gave a valid pose{bridged}")
    print(f"control steps: {steps}, due every {1e3 * config.scanner.period:.3g} ms")
    if config.bag:
        print(bags_text(config.out, summary["bags"]))
    print(f"{config.out / RUNS_FILE}: {run.wall:.1f} s")


def _require_drivable(config: Config, path: Reference, slip: Compensation, world: World) -> None:
    """Raise InvalidValueError for a path that is too fast for the robot."""
    slip.reset(path.pose([0.0]))
    geometry = world.robot.geometry
    top_speed = world.drive.top_speed
    if config.reference != "circle":
        require_drivable("reference", config.reference, path, slip.law(), geometry, top_speed)
        return
    demand = Demand.of(path, slip.law(), geometry)
    if demand.exceeds(top_speed):
        speed = demand.possible_speed(top_speed)
        allowed = f"at most {speed:g} m/s on this circle: {demand.reason(top_speed)}"
        raise InvalidValueError("circle_speed", config.circle_speed, allowed)
