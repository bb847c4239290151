"""`trackslip identify`: slip laws from a stored grid or from a real robot's log."""

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import tyro

from experiments.options.bag_choice import Bag, BagOptions
from experiments.options.base import (
    Distinct,
    Excludes,
    Exclusion,
    NonNegative,
    Positive,
    ResultsOptions,
    Within,
    default_is,
)
from experiments.options.sensing import check_sensor
from experiments.options.world import Method
from trackslip.doubts import Accepted
from trackslip.errors import InvalidValueError
from trackslip.kinematics import GEARS
from trackslip.motion.constant_speed import SETTLE

if TYPE_CHECKING:
    from trackslip.identification.source import Source

EXAMPLES = (
    ("from a stored grid", "trackslip identify out/grid"),
    ("from a real robot's log", "trackslip identify log.csv --half-gauge 0.168 --sprocket-radius 0.06"),
    ("from a ROS bag", "trackslip identify run.mcap --half-gauge 0.168 --sprocket-radius 0.06"),
    ("from some runs of a sweep", "trackslip identify out/grid --where ground=ice"),
    ("from a drive, with a sensor 0.3 m ahead", "trackslip identify out/wander --method drive --sensor 0.3 0 0"),
    ("as in the paper", "trackslip identify out/grid --motion paper --out out/identify-paper"),
)
_SHOWN = tyro.conf.arg(help_behavior_hint="(default: where the driving shows it)")


@dataclass(frozen=True)
class Config(ResultsOptions):
    """Fit the slip laws to a stored grid or to the log of a real robot, and print and report them.

    A log is a ROS bag, or has the columns run, t, omega_l, omega_r, x, y, phi (any driving) or omega_l, omega_r, v, w
    (steady samples).
    """

    path: tyro.conf.Positional[Path]
    """Folder of a stored grid, a .csv or .parquet log, or a ROS bag (.bag, .mcap, .db3, or a folder of them)."""
    where: Annotated[tuple[str, ...] | None, Distinct("NAME=VALUE"), default_is("all", "NAME=VALUE ...")] = None
    """Runs of a sweep to use: ground=ice friction_ratio=1.2."""
    half_gauge: Annotated[float | None, Positive(100.0, "m"), default_is("the log's", "FLOAT")] = None
    """Half the distance between the tracks [m]."""
    sprocket_radius: Annotated[float | None, Positive(100.0, "m"), default_is("the log's", "FLOAT")] = None
    """Radius of the sprockets [m]."""
    gear: Annotated[float, Within(*GEARS)] = 1.0
    """Encoder revolutions per sprocket revolution, if omega is the encoder's speed [-]."""
    method: Annotated[
        Literal["steady", "drive"] | None, default_is("steady where most of the driving is", "{steady,drive}")
    ] = None
    """Data to fit: stretches of constant sprocket speeds, or whole drives."""
    sensor: Annotated[tuple[float, float, float] | None, default_is("estimated", "X Y YAW")] = None
    """Place of the poses' sensor, ahead of and left of the middle of the tracks, and its heading there [m, m, rad]."""
    estimate_sensor: Annotated[bool | None, _SHOWN] = None
    """Estimate the sensor's place from steady stretches; whole drives always do unless --sensor is given."""
    motion: Method = None
    """Method that estimates the twist of a run; bundle needs ranges (see grid)."""
    accept: Annotated[tuple[Accepted, ...] | None, Distinct("KIND"), default_is("none", "KIND ...")] = None
    """Runs to use although these look wrong in them; warnings of what is left out name the word."""
    settle: Annotated[float, NonNegative(3600.0, "s")] = SETTLE
    """Time left out of each run after the sprockets have become steady [s]."""
    bag: Bag = field(default_factory=BagOptions)
    """Topics to read from a bag."""
    out: Path = Path("out/identify")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figures as PDF."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Excludes(("motion", "settle", "estimate_sensor"), "method", ("drive",)),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_sensor(self.sensor)
        if self.sensor is not None and self.estimate_sensor:
            raise InvalidValueError("estimate_sensor", True, "left out where --sensor is given")


def run(config: Config) -> None:
    """Fit the laws, store and print them."""
    from experiments.report.identification import page, print_identification
    from experiments.run import Run
    from experiments.storage.manifest import command_line
    from experiments.storage.results import REPORT_FILE, write_samples
    from trackslip.identification.identify import identify_source
    from trackslip.identification.result import identification_to_json
    from trackslip.identification.source import origin
    from trackslip.se2 import Mounting
    from trackslip.slip.families import drive_laws

    stages = 3 + len(drive_laws())  # reading, steady stretches, each law of whole drives, the report
    with Run(config) as run, run.progress("identification", stages, "stages") as report:
        source = source_of(config)
        report(1)
        sensor = None if config.sensor is None else Mounting(*config.sensor)
        with run.watch.stage("identify"):
            found = identify_source(source, config.method, sensor, config.estimate_sensor, report)
        manifest = run.manifest(**origin(found.logs))
        if not found.logs:
            write_samples(run.folder, found.samples)
        run.write(identification_to_json(found), found.logs, manifest=manifest)
        title = f"Slip laws identified from “{config.path.resolve().name}”"
        page(found, title, command_line("identify"), manifest).write(run.folder, config.pdf)
        report(1)
    print_identification(found, source.taken)
    print(f"{config.out / REPORT_FILE}: {run.wall:.1f} s")


def source_of(config: Config) -> "Source":
    """The runs and samples that the options select; raises LogError or InvalidValueError if none can be used."""
    from experiments.sweep.table import chosen
    from trackslip.identification.source import ReadOptions, read_source

    bag, accept = config.bag.choice(), config.accept or ()
    reading = ReadOptions(
        config.half_gauge, config.sprocket_radius, config.gear, config.settle, config.motion, bag, accept
    )
    return read_source(config.path, reading, partial(chosen, where=config.where) if config.where else None)
