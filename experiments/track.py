"""`trackslip track`: follow a path once in closed loop."""

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import degrees
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final

import numpy as np
import tyro

from experiments.common.choices import COMPENSATIONS, CONTROLLERS, REFERENCES, WITHOUT_LAWS
from experiments.common.lookup import compensation
from experiments.common.manifest import command_line
from experiments.common.options import Excludes, Exclusion, Needs, Within, default_is
from experiments.common.page import Answer, Page, Plot, Section
from experiments.common.results import REPORT_FILE, bags_text, write_bags
from experiments.common.run import Run
from experiments.common.table import number, percent
from experiments.common.traces import Traces
from experiments.recorder import record_all
from experiments.simulate import options
from experiments.simulate.closed_loop import (
    ClosedLoopRun,
    Loop,
    drive_closed_loops,
    require_able,
)
from experiments.simulate.grid_summary import (
    LocalizationErrors,
    saturation_warnings,
    simulated_seconds,
    soil_warnings,
)
from experiments.simulate.motors import without_motors
from experiments.simulate.paths import PathSummary, WaypointOptions
from experiments.simulate.run_charts import errors_chart, path_chart, slip_chart
from experiments.simulate.tracking import TrackingResult, tracking_results, tracking_table
from experiments.simulate.world import World
from sim.motors.motor import Drive
from sim.runs.stopwatch import StepTimes, Stopwatch
from trackslip.bags.open import require_rosbags
from trackslip.errors import InvalidValueError
from trackslip.logs.runlog import RunLog
from trackslip.metrics import TRANSIENT
from trackslip.online.compensation import Compensation
from trackslip.trajectory.base import Reference
from trackslip.trajectory.drivable import Demand, require_drivable
from trackslip.trajectory.named import CIRCLE_RADIUS, CIRCLE_SPEED, one_circle

EXAMPLES: Final = (
    ("the paper's path and controller", "trackslip track"),
    ("without slip compensation", "trackslip track --compensation none --out out/track-none"),
    (
        "with online identification",
        "trackslip track --controller lqr --compensation online --out out/track-online",
    ),
    (
        "with your own laws",
        "trackslip track --laws out/identify --compensation icr --out out/track-icr",
    ),
)
ESSENTIAL: Final = (
    "controller",
    "compensation",
    "reference",
    "laws",
    "localization",
    "robot",
    "ground.source",
    "rrd",
    "out",
    "overwrite",
)


@dataclass(frozen=True)
class Config(options.Simulation, options.ClosedLoopOptions, WaypointOptions):
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
    """Path: the paper's takes 45.8 s, a .csv file has waypoints x,y[,yaw][,v]."""
    circle_radius: Annotated[float, Within(0.1, options.MAX_RADIUS, "m")] = CIRCLE_RADIUS
    """Radius of the circle, which turns left; needs --reference circle [m]."""
    circle_speed: float = CIRCLE_SPEED
    """Speed on the circle; needs --reference circle [m/s]."""
    circle_duration: Annotated[
        float | None, Within(1.0, options.MAX_DURATION, "s"), default_is("once round", "FLOAT")
    ] = None
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
    pdf: bool = False
    """Also write the figures as PDF."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Needs(("circle_radius", "circle_speed", "circle_duration"), "reference", ("circle",)),
        Excludes(("laws",), "compensation", WITHOUT_LAWS),
    )

    def check(self, drive: Drive) -> None:
        """Raise InvalidValueError for options that the robot's drive does not allow."""
        super().check(drive)
        if self.reference == "circle":
            options.require_speed("circle_speed", self.circle_speed, drive.top_speed)
        self.require_file((self.reference,), drive.top_speed)


def run(config: Config) -> None:
    """Drive the path once, store the run, and print its errors."""
    if config.bag:
        require_rosbags()
    world = World.of(config)
    names = (config.controller, config.compensation)
    name = " ".join(names)
    plan = config.plan(world.robot.geometry.half_gauge, world.drive.top_speed)
    path = plan.path(config.reference)
    metadata = plan.metadata(config.reference)
    if config.reference == "circle":
        path = one_circle(config.circle_radius, config.circle_speed, config.circle_duration)
        metadata["circle"] = {
            "radius": config.circle_radius,
            "speed": config.circle_speed,
            "duration": path.duration,
        }
    start = path.pose(0.0) if config.start is None else np.array(config.start)
    case = ClosedLoopRun(name, f"track {name}", config.seed, *names, start, metadata=metadata)
    law = partial(compensation, robot=world.robot.geometry, laws=config.laws)
    require_able([case], world, path, law)
    _require_drivable(config, path, law(config.compensation), world)
    about_path = PathSummary.of(config.reference, path, plan.limits)
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
            "path": about_path,
            "timing": {
                "step_s": steps.median,
                "p99_step_s": steps.p99,
                "worst_step_s": steps.worst,
            },
        }
        if config.bag:
            summary["bags"] = write_bags(run.folder, [log.run for log in logs], logs)
        manifest = run.manifest(**world.about)
        run.write(summary, logs, simulated_seconds(logs), manifest)
        late = steps.warning(config.controller, config.scanner.period)
        warnings = [*about_path.warnings(plan), *saturation_warnings(logs), *soil_warnings(logs)]
        warnings += [late] if late else []
        notes = without_motors(config.robot, world.drive)
        page = _page(config, logs[0], results[0], poses, warnings, notes, manifest)
        page.write(run.folder, config.pdf)
        if config.rrd:
            with run.busy("recording"):
                record_all(run.folder, logs)
    print(about_path)
    tracking_table(results).print()
    for warning in warnings:
        print(f"Warning: {warning}.")
    for note in notes:
        print(f"Note: {note}.")
    bridged = "; odometry bridged the rest" if poses.valid_fraction < 1 else ""
    print(f"{poses.valid_fraction:.1%} of the scans gave a valid pose{bridged}")
    print(f"control steps: {steps}, due every {1e3 * config.scanner.period:.3g} ms")
    if config.bag:
        print(bags_text(config.out, summary["bags"]))
    print(f"{config.out / REPORT_FILE}: {run.wall:.1f} s")


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


def _page(
    config: Config,
    log: RunLog,
    result: TrackingResult,
    poses: LocalizationErrors,
    warnings: Sequence[str],
    notes: Sequence[str],
    manifest: Mapping[str, Any],
) -> Page:
    """The page on a run: its errors, its path beside the reference, and errors and slip over
    time.
    """
    run = Traces(log)
    plots = [
        Plot(
            "path_and_errors",
            [chart for chart in (path_chart(run), errors_chart(run)) if chart is not None],
            "Path and errors",
            "Errors of the true pose from the reference at the same time: ahead of and to the left "
            "of the reference's pose, in the robot's frame, and their distance.",
        ),
        Plot(
            "slip",
            slip_chart(run),
            "Slip",
            "Slip of both tracks, true and as the compensation assumes it for its set points.",
        ),
    ]
    name = f"{config.controller} with {config.compensation} on the path {config.reference}"
    return Page(
        name[0].upper() + name[1:],
        command_line("track"),
        manifest,
        [Section("Run", plots)],
        answer=_answer(config, result, poses, warnings, notes),
    )


def _answer(
    config: Config,
    result: TrackingResult,
    poses: LocalizationErrors,
    warnings: Sequence[str],
    notes: Sequence[str],
) -> Answer:
    """The answer: how far the robot was from the reference."""
    errors = result.errors
    settled = errors.rms_position_after_12s
    heading = f"{number(1e3 * errors.rms_position, 1)} mm rms from the reference"
    if math.isfinite(settled):
        heading = f"{number(1e3 * settled, 1)} mm rms from the reference, from {TRANSIENT:g} s on"
    alarms = []
    if not errors.success:
        alarms = [f"The robot left the reference, by up to {errors.max_position:.2f} m"]
    facts = [
        ("position error", f"{number(1e3 * errors.rms_position, 1)} mm rms over the whole run"),
        ("largest", number(1e3 * errors.max_position, 1, "mm")),
        (
            "at the end",
            f"{number(1e3 * errors.final_position, 1)} mm, {degrees(errors.final_heading):.2f}°",
        ),
        ("scans with a valid pose", percent(poses.valid_fraction)),
        ("poses by", result.localization),
    ]
    if alarms and math.isfinite(settled):
        facts.insert(0, ("from 12 s on", f"{number(1e3 * settled, 1)} mm rms"))
    lines = [f"{note[0].upper()}{note[1:]}." for note in notes]
    view = f"trackslip view {shlex.quote(str(config.out))}"
    return Answer(heading, facts, lines, warnings, alarms, [view])
