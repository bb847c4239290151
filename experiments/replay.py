"""`trackslip replay`: the simulated robot driven as a log says that a robot drove."""

from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import tyro

from experiments.common.log_options import MAX_CLOCK_OFFSET, Bag, BagOptions, check_sensor
from experiments.common.options import Exclusion, Needs, ResultsOptions, Whole, Within, default_is
from experiments.simulate.options import MAX_THREADS, DriveOptions, GroundOptions, RobotSource
from trackslip.kinematics import GEARS

EXAMPLES = (
    ("a log, by the robot of a file", "trackslip replay log.csv --robot robot.toml"),
    ("a stored drive on ice, from its commands", "trackslip replay out/wander --ground ice --inputs commands"),
)
SIMULATED = "simulated"
_MAX_RECORDED = 20  # drives


@dataclass(frozen=True)
class Config(ResultsOptions):
    """Drive the simulated robot as a log says that a robot drove, and compare both motions.

    The log is one that identify reads. Every drive in it is replayed from its own start, with its first motion.
    """

    path: tyro.conf.Positional[Path]
    """Folder of a stored drive or grid, a .csv or .parquet log, or a ROS bag (.bag, .mcap, .db3, or their folder)."""
    robot: RobotSource = "shipped"
    """Robot: a name, or a file; it states half gauge and sprocket radius."""
    ground: GroundOptions = field(default_factory=GroundOptions)
    """The ground, and properties that differ from the named one's."""
    inputs: Literal["encoders", "commands"] = "encoders"
    """What drives the robot: measured sprocket speeds, or the logged commands through its drive."""
    drive: DriveOptions = field(default_factory=DriveOptions)
    """Properties of servo and motor that differ from the robot's, for --inputs commands."""
    gear: Annotated[float, Within(*GEARS)] = 1.0
    """Encoder revolutions per sprocket revolution, if omega is the encoder's speed [-]."""
    sensor: Annotated[tuple[float, float, float] | None, default_is("the middle", "X Y YAW")] = None
    """Place of the poses' sensor, ahead of and left of the middle of the tracks, and its heading there [m, m, rad]."""
    clock_offset: Annotated[float, Within(-MAX_CLOCK_OFFSET, MAX_CLOCK_OFFSET, "s")] = 0.0
    """Encoder clock minus pose clock [s]."""
    bag: Bag = field(default_factory=BagOptions)
    """Topics to read from a bag."""
    threads: Annotated[int, Whole(0, MAX_THREADS)] = 0
    """Number of worker threads, 0 for one per processor; the results don't depend on it."""
    rrd: bool = False
    """Also record measured and simulated motion of up to 20 drives side by side, for the rerun viewer."""
    out: Path = Path("out/replay")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figures as PDF."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (Needs(("drive",), "inputs", ("commands",)),)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_sensor(self.sensor)


def run(config: Config) -> None:
    """Replay, store, report and print."""
    from experiments.common.manifest import command_line
    from experiments.common.plain_json import plain
    from experiments.common.results import RECORDINGS_FOLDER, REPORT_FILE, TABLE_FILE, file_names
    from experiments.common.run import Run
    from experiments.evaluate.odometry import Evaluated, evaluated, pose_doubts, summary_of, write_error_table
    from experiments.evaluate.odometry_page import page, print_errors, sensing_lines
    from experiments.recorder import record
    from sim.ground.named import load_ground
    from sim.log_replay import Replayer, replayed_log
    from sim.robot.named import load_parameters
    from trackslip.errors import LogError
    from trackslip.identification.source import ReadOptions, read_source
    from trackslip.odometry.evaluation import errors_of, estimated_trajectory
    from trackslip.odometry.identified import no_slip
    from trackslip.se2 import Mounting

    parameters, ground = load_parameters(config.robot)
    parameters = replace(parameters, drive=config.drive.changed(parameters.drive))
    ground = config.ground.changed(load_ground(config.ground.source) if config.ground.source else ground)
    geometry, sensor = parameters.geometry, Mounting(*(config.sensor or (0.0, 0.0, 0.0)))
    with Run(config) as run, run.progress("replay", 3, "stages") as step:
        reading = ReadOptions(geometry.half_gauge, geometry.sprocket_radius, config.gear, bag=config.bag.choice())
        source = read_source(config.path, reading)
        if not source.logs:
            raise LogError(f"{source.name}: holds steady samples; a replay needs drives with times and poses")
        step(1.0)
        inputs = Replayer(source.logs, config.inputs)
        with run.watch.stage("physics"):
            motion = inputs.run(parameters, ground, config.threads)
        step(1.0)
        about = {"geometry": asdict(geometry), "ground": plain(ground), "inputs": config.inputs}
        logs = [replayed_log(motion, k, one, sensor, config.clock_offset, about) for k, one in enumerate(source.logs)]
        trajectories, notes = [], [*source.notes, *map(str, source.refused)]
        for k, log in enumerate(source.logs):
            try:
                place = partial(motion.sensor_at, k, sensor)
                trajectories.append(estimated_trajectory(log, place, geometry, config.clock_offset))
            except LogError as error:
                notes.append(str(error))
        simulated = replace(no_slip(geometry), name=SIMULATED)
        found = [Evaluated(SIMULATED, simulated, sensor, config.clock_offset, errors_of(trajectories))]
        found += evaluated([("no slip", no_slip(geometry))], source.logs, sensor, config.clock_offset)[:1]
        notes += [*found[0].errors.notes, *pose_doubts(found)]
        sensing = sensing_lines(found, config.sensor is not None, True)
        manifest = run.manifest(robot=parameters, ground=ground)
        run.write({"models": {one.label: summary_of(one) for one in found}, "warnings": notes}, logs, manifest=manifest)
        write_error_table(found, run.folder / TABLE_FILE)
        title = f"Replay of “{config.path.resolve().name}”"
        intro = f"The robot is simulated by the {config.inputs} of the log, and compared"
        page(found, notes, sensing, manifest, command_line("replay"), title, intro, "model").write(
            run.folder, config.pdf
        )
        if config.rrd:
            with run.busy("recordings"):
                names = file_names([log.run for log in logs[:_MAX_RECORDED]], ".rrd")
                for name, measured, driven in zip(names, source.logs, logs, strict=False):
                    both = [replace(measured, run="measured", truth=None), replace(driven, run=SIMULATED)]
                    record(run.folder / RECORDINGS_FOLDER / name, both)
        step(1.0)
    print_errors(found, notes, sensing, "model")
    print(f"{config.out / REPORT_FILE}: {run.wall:.1f} s")
