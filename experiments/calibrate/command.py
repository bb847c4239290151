"""`trackslip calibrate`: the simulated robot fitted to published slips, or to the log of a robot."""

from experiments.calibrate.calibration import fold_labels, print_fits, read_target, summary_of, tested, variants
from experiments.calibrate.config import GROUND, OF_DRIVES, OF_TURNS, ROBOT, Config
from experiments.common.manifest import command_line
from experiments.common.run import Run
from experiments.recorder import record_all
from experiments.simulate.grid_runs import sample_runs
from sim.calibration.calibration import calibrate, random_starts
from sim.calibration.candidate import Candidate
from sim.calibration.targets import Drives, TurnTable
from sim.ground.named import load_ground
from sim.robot.named import load_parameters
from sim.robot.parameters import ground_file_text, robot_file_text
from sim.seeds import generator
from trackslip.se2 import Mounting


def run(config: Config) -> None:
    """Fit, store and print."""
    with Run(config) as run:
        robot, ground = load_parameters(config.robot)
        ground = config.ground.changed(load_ground(config.ground.source) if config.ground.source else ground)
        base = Candidate(robot, ground, Mounting(*(config.sensor or (0.0, 0.0, 0.0))), config.clock_offset)
        target = read_target(config.target, config, base)
        free = config.free or (OF_DRIVES if isinstance(target, Drives) else OF_TURNS)
        count = config.starts if config.starts is not None else 5 * isinstance(target, TurnTable)
        folds = fold_labels(target, config.hold_out, config.folds)
        with run.progress(
            f"calibration to {config.target}", 3 + count + (0 if folds is None else int(folds.max()) + 1), "fits"
        ) as report:
            further = random_starts(free, count, generator(config.seed, "calibrate"))
            best = calibrate(target, base, free, folds, further, report)
            others = variants(target, base, best)
            report(1)
            again = tested(config, base, best) if config.test else None
            report(1)
        fitted, comment = best.candidate, f"made by: {command_line('calibrate')}"
        for name, text in (
            (ROBOT, robot_file_text(fitted.robot, fitted.ground, comment)),
            (GROUND, ground_file_text(fitted.ground, comment)),
        ):
            (run.folder / name).write_text(text, encoding="utf-8")
        run.write(summary_of(best, others, again), seed=config.seed)
        if config.rrd:
            with run.busy("recordings"):
                record_all(run.folder, sample_runs(str(run.folder / ROBOT), config))
    print_fits(f"Calibrated to {config.target}", best, others, again)
    place, clock = fitted.sensor, fitted.clock
    sensing = f" --sensor {place.x:.3g} {place.y:.3g} {place.yaw:.3g} --clock-offset={clock:.3g}"
    known = f"--robot {config.out / ROBOT} --ground {config.out / GROUND}"
    print(f"{config.out}: {run.wall:.1f} s; use {known}{sensing if fitted.sensor != Mounting() or clock else ''}")
