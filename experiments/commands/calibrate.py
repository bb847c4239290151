"""`trackslip calibrate`: the simulated robot fitted to published slips, or to the log of a robot."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar, Literal, get_args

from experiments.options.bag_choice import Bag, BagOptions
from experiments.options.base import Distinct, Excludes, Exclusion, Whole, Within, default_is
from experiments.options.choices import SHIPPED
from experiments.options.sensing import MAX_CLOCK_OFFSET, check_sensor
from experiments.options.world import GroundOptions, Repeatable, RobotSource
from trackslip.errors import InvalidValueError
from trackslip.kinematics import GEARS

Parameter = Literal[
    "half_gauge",
    "contact_length",
    "radius_error",
    "radius_left",
    "radius_right",
    "friction",
    "friction_ratio",
    "shear",
    "com_x",
    "com_y",
    "com_height",
    "yaw_inertia",
    "sensor_x",
    "sensor_y",
    "sensor_yaw",
    "clock",
    "lag",
    "delay",
    "droop",
]
OF_TURNS: tuple[Parameter, ...] = ("friction_ratio", "radius_error", "com_y")
OF_DRIVES: tuple[Parameter, ...] = ("friction", "friction_ratio", "radius_error", "sensor_x", "clock")
"""Parameters to fit by default: to tables and steady samples, and to drives."""
MAX_STARTS = 100
ROBOT, GROUND = "robot.toml", "ground.toml"
EXAMPLES = (
    ("to the paper's slips and radii", "trackslip calibrate"),
    ("to half of a log", "trackslip calibrate --target log.csv --robot husky --hold-out 0.5"),
    ("to obeyed commands", "trackslip calibrate --target log.csv --free lag delay clock"),
)


@dataclass(frozen=True)
class Config(Repeatable):
    """Fit parameters of the simulated robot, its ground, drive and sensor to published slips or to a log.

    A log is one that identify reads: drives or windows with poses, or steady samples. A table of turns has the columns
    radius and speed (commanded, to the left), observed_radius, slip_outer, slip_inner.
    """

    target: Annotated[str, default_is("published", "published|FILE")] = "published"
    """Data: the paper's Eq. 11 and Fig. 5 (published), a log, a ROS bag or a folder, or a .csv table of turns."""
    free: Annotated[
        tuple[Parameter, ...] | None,
        Distinct("parameter"),
        default_is(
            f"{' '.join(OF_TURNS)}; for drives {' '.join(OF_DRIVES)}", f"{{{','.join(get_args(Parameter))}}} ..."
        ),
    ] = None
    """Parameters to fit; friction_ratio is across / along, radii are relative errors; lag to droop need commands."""
    robot: RobotSource = SHIPPED
    """Robot with the initial values, and with the values of the parameters that are not fitted."""
    ground: GroundOptions = field(default_factory=GroundOptions)
    """The ground with the initial values."""
    gear: Annotated[float, Within(*GEARS)] = 1.0
    """Encoder revolutions per sprocket revolution, if omega is the encoder's speed [-]."""
    sensor: Annotated[tuple[float, float, float] | None, default_is("the middle", "X Y YAW")] = None
    """Place of the poses' sensor, ahead of and left of the middle of the tracks, and its heading there [m, m, rad]."""
    clock_offset: Annotated[float, Within(-MAX_CLOCK_OFFSET, MAX_CLOCK_OFFSET, "s")] = 0.0
    """Initial encoder clock minus pose clock [s]."""
    bag: Bag = field(default_factory=BagOptions)
    """Topics to read from a bag."""
    hold_out: Annotated[float | None, Within(0.01, 0.99), default_is("nothing", "FLOAT")] = None
    """Share at the end of the log that is predicted by a fit to the rest [-]."""
    folds: Annotated[int | None, Whole(2, 20), default_is("none", "INT")] = None
    """Number of parts of the log, each of which is predicted by a fit to the others."""
    test: Annotated[Path | None, default_is("none", "LOG")] = None
    """Another log to predict, for which only the clock is fitted."""
    starts: Annotated[int | None, Whole(0, MAX_STARTS), default_is("5 for a table of turns, else 0", "INT")] = None
    """Number of random starts in addition to the robot's own values."""
    rrd: bool = False
    """Also record the calibrated robot turning at the paper's radii, for the rerun viewer, in OUT/recordings."""
    out: Path = Path("out/calibrate")
    """Folder for the results, including robot.toml and ground.toml."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Excludes(("folds", "test"), "hold_out"),
        Excludes(("test",), "folds"),
        Excludes(("gear", "sensor", "clock_offset", "hold_out", "folds", "test"), "target", ("published",)),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.target:
            raise InvalidValueError("target", self.target, "published, or a file")
        check_sensor(self.sensor)


def run(config: Config) -> None:
    """Fit, store and print."""
    from experiments.calibration import fold_labels, print_fits, read_target, summary_of, tested, variants
    from experiments.driving.grid_runs import sample_runs
    from experiments.recording import record_all
    from experiments.run import Run
    from experiments.storage.manifest import command_line
    from sim.calibration.calibration import calibrate, random_starts
    from sim.calibration.candidate import Candidate
    from sim.calibration.targets import Drives, TurnTable
    from sim.ground.named import load_ground
    from sim.robot.named import load_parameters
    from sim.robot.parameters import ground_file_text, robot_file_text
    from sim.seeds import generator
    from trackslip.se2 import Mounting

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
