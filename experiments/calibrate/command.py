"""`trackslip calibrate`: fit the simulated robot to published slips or to a robot's log."""

from pathlib import Path

from experiments.calibrate.calibration import (
    error_table,
    first_candidate,
    fit_summary,
    fold_labels,
    parameter_table,
    read_target,
    remarks,
    summary_of,
    tested,
)
from experiments.calibrate.config import GROUND, OF_DRIVES, OF_PULLS, OF_TURNS, ROBOT, Config
from experiments.calibrate.page import gain, page
from experiments.calibrate.pulls import read_pulls, require_pulls
from experiments.common.manifest import command_line
from experiments.common.results import REPORT_FILE
from experiments.common.run import Run
from experiments.simulate.motors import print_motors
from sim.calibration.calibration import calibrate
from sim.calibration.candidate import OF_DRIVE, Candidate
from sim.calibration.pull_test import fit_pulls, require_soft
from sim.calibration.targets import Drives
from sim.motors.motor import or_tireless
from sim.robot.parameters import ground_file_text, robot_file_text
from trackslip.errors import require
from trackslip.se2 import Mounting


def _fit_soil(config: Config, base: Candidate, run: Run) -> None:
    """Fit soft soil to a pull test, and store, report and print the results."""
    require_pulls(config, base)
    test = read_pulls(Path(config.target), base)
    with run.busy("fit"):
        fit = fit_pulls(test, base, config.free or OF_PULLS)
    comment = f"made by: {command_line('calibrate')}"
    text = ground_file_text(fit.candidate.ground, comment)
    (run.folder / GROUND).write_text(text, encoding="utf-8")
    manifest = run.manifest()
    run.write(fit_summary(fit), manifest=manifest)
    following = f"trackslip predict --ground {config.out / GROUND}"
    page(fit, base, test, None, following, manifest).write(run.folder, config.pdf)
    parameter_table(f"Soil calibrated to {config.target}", fit).print()
    error_table(fit, None).print()
    for line in (*remarks(fit, None), gain(fit, None)):
        print(line)
    print(f"{config.out / REPORT_FILE}: {run.wall:.1f} s; next: {following}")


def run(config: Config) -> None:
    """Fit the robot, and store, report and print the results."""
    with Run(config) as run:
        base = first_candidate(config.robot, config.ground, config.sensor, config.clock_offset)
        base.ground.require_even("robots are calibrated on even, level ground")
        if base.ground.soil is not None:
            _fit_soil(config, base, run)
            return
        require_soft(base, config.free or ())
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
        following = f"trackslip evaluate LOG {use}"
        page(fit, base, target, test, following, manifest).write(run.folder, config.pdf)
    parameter_table(f"Calibrated to {config.target}", fit).print()
    error_table(fit, test).print()
    for line in (*remarks(fit, test), gain(fit, test)):
        print(line)
    print(f"{config.out / REPORT_FILE}: {run.wall:.1f} s; use {use}")
