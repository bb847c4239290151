"""`trackslip calibrate`: fit the simulated robot to published slips or to a robot's log."""

from experiments.calibrate.calibration import (
    error_table,
    first_candidate,
    fold_labels,
    parameter_table,
    read_target,
    remarks,
    summary_of,
    tested,
)
from experiments.calibrate.config import GROUND, OF_DRIVES, OF_TURNS, ROBOT, Config
from experiments.calibrate.page import gain, page
from experiments.common.manifest import command_line
from experiments.common.results import REPORT_FILE
from experiments.common.run import Run
from experiments.simulate.motors import print_motors
from sim.calibration.calibration import calibrate
from sim.calibration.candidate import OF_DRIVE
from sim.calibration.targets import Drives
from sim.motors.motor import or_tireless
from sim.robot.parameters import ground_file_text, robot_file_text
from trackslip.errors import require
from trackslip.se2 import Mounting


def run(config: Config) -> None:
    """Fit the robot, and store, report and print the results."""
    with Run(config) as run:
        base = first_candidate(config.robot, config.ground, config.sensor, config.clock_offset)
        base.ground.require_even("robots are calibrated on even, level ground")
        base.ground.require_firm("parameters of soil are not fitted")
        target = read_target(config.target, config, base)
        if not isinstance(target, Drives):
            allowed = "left out: only drives have a clock, not turns or steady samples"
            require(config.clock_offset == 0, "clock_offset", config.clock_offset, allowed)
        other = None if config.test is None else read_target(str(config.test), config, base)
        free = config.free or (OF_DRIVES if isinstance(target, Drives) else OF_TURNS)
        if OF_DRIVE & set(free):  # commands drive the robot, no longer measured speeds
            print_motors(config.robot, or_tireless(base.robot.drive))
        folds = fold_labels(target, config.folds)
        fits = 2 + (config.folds or 0)
        with run.progress(f"calibration to {config.target}", fits, "fits") as report:
            fit = calibrate(target, base, free, folds, progress=report)
            test = None if other is None else tested(other, base, fit)
            report(1)
        fitted = fit.candidate
        comment = f"made by: {command_line('calibrate')}"
        (run.folder / ROBOT).write_text(
            robot_file_text(fitted.robot, fitted.ground, comment), encoding="utf-8"
        )
        (run.folder / GROUND).write_text(ground_file_text(fitted.ground, comment), encoding="utf-8")
        manifest = run.manifest()
        run.write(summary_of(fit, test), manifest=manifest)
        place = fitted.sensor
        clock = fitted.clock
        use = f"--robot {config.out / ROBOT} --ground {config.out / GROUND}"
        if place != Mounting() or clock:
            use += (
                f" --sensor {place.x:.3g} {place.y:.3g} {place.yaw:.3g} --clock-offset={clock:.3g}"
            )
        page(fit, base, target, test, use, manifest).write(run.folder, config.pdf)
    parameter_table(f"Calibrated to {config.target}", fit).print()
    error_table(fit, test).print()
    for line in (*remarks(fit, test), gain(fit, test)):
        print(line)
    print(f"{config.out / REPORT_FILE}: {run.wall:.1f} s; use {use}")
