"""The options of `trackslip evaluate`."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar, Final, Literal

import tyro

from experiments.calibrate.config import Parameter
from experiments.common.log_names import refuse_same_logs
from experiments.common.log_options import (
    Bag,
    BagOptions,
    LayoutOptions,
    MaxMemory,
    TableLayout,
    check_sensor,
)
from experiments.common.options import (
    Distinct,
    Exclusion,
    Needs,
    Positive,
    ResultsOptions,
    Whole,
    Within,
    default_is,
)
from experiments.simulate.options import GroundOptions
from trackslip.errors import require
from trackslip.identification.source import MULTIPLIERS
from trackslip.kinematics import GEARS

EXAMPLES: Final = (
    ("a law and no compensation", "trackslip evaluate out/wander --law out/identify --law none"),
    (
        "two laws on a ROS bag",
        "trackslip evaluate run.mcap --law out/mine --law out/mine:icr --out out/two",
    ),
    (
        "laws and a robot, fitted to the other half",
        "trackslip evaluate log.csv --robot husky --folds 2 --free lag --out out/folds",
    ),
    (
        "a data set with its bounds",
        "trackslip evaluate examples/logs/ice.toml --out out/reality_ice",
    ),
    (
        "laws from two grounds on two logs",
        "trackslip evaluate a.csv b.csv --law out/a --law out/b --out out/table",
    ),
)
ESSENTIAL: Final = (
    "logs",
    "law",
    "robot",
    "ground.source",
    "folds",
    "free",
    "half_gauge",
    "sprocket_radius",
    "sensor",
    "out",
    "overwrite",
)
MAX_FOLDS: Final = 10
_SIZE: Final = default_is("the log's, the laws' or the robot's", "FLOAT")


@dataclass(frozen=True)
class Config(ResultsOptions):
    """Measure how well slip laws and simulated robots predict a log from its encoders, compared
    with no slip.

    The log needs poses, and laws must come from other logs, unless --folds fits them to the log's
    other parts. A data set is a .toml file that states log, models and bounds; the command exits
    with 1 if a bound is exceeded.
    """

    logs: Annotated[
        tyro.conf.Positional[tuple[Path, ...]],
        tyro.conf.arg(metavar="LOG [LOG ...]", help_behavior_hint="(required)"),
    ]
    """A .csv or .parquet log, a ROS bag, a folder with a drive, a grid or bags, or a data set's
    .toml file. Several logs give a table of errors, model by log.
    """
    law: Annotated[
        tuple[str, ...], tyro.conf.UseAppendAction, default_is("none; may be repeated", "LAW")
    ] = ()
    """none, a folder (its best law) or file of laws, optionally with :NAME, or, to fit a law by
    --folds, its name.
    """
    robot: Annotated[
        tuple[str, ...], tyro.conf.UseAppendAction, default_is("none; may be repeated", "ROBOT")
    ] = ()
    """A robot to simulate: a name, or a file as written by calibrate."""
    ground: GroundOptions = field(default_factory=GroundOptions)
    """Ground of the simulated robots, and properties that differ from the named ground."""
    inputs: Literal["encoders", "commands"] = "encoders"
    """Inputs of simulated robots: measured sprocket speeds, or the logged commands through the
    robot's drive.
    """
    folds: Annotated[int | None, Whole(2, MAX_FOLDS), default_is("nothing is fitted", "INT")] = None
    """Number of parts of the log, each predicted by laws, gains and robots fitted to the other
    parts.
    """
    free: Annotated[
        tuple[Parameter, ...] | None, Distinct("parameter"), default_is("none", "NAME ...")
    ] = None
    """Parameters of the first robot to fit to the log's other parts, as calibrate does."""
    half_gauge: Annotated[float | None, Positive(100.0, "m"), _SIZE] = None
    """Half the distance between the tracks [m]."""
    sprocket_radius: Annotated[float | None, Positive(100.0, "m"), _SIZE] = None
    """Radius of the sprockets [m]."""
    gear: Annotated[float, Within(*GEARS)] = 1.0
    """Encoder revolutions per sprocket revolution, if omega is the encoder's speed [-]."""
    multiplier: Annotated[float | None, Within(*MULTIPLIERS), default_is("1", "FLOAT")] = None
    """wheel_separation_multiplier of the odometry that is used instead of encoders [-]."""
    sensor: Annotated[
        tuple[float, float, float] | None, default_is("as identified, or the middle", "X Y YAW")
    ] = None
    """Position of the pose sensor, ahead and to the left of the turning centre, and its heading [m,
    m, rad].
    """
    clock_offset: Annotated[
        float | None, Within(-3600.0, 3600.0, "s"), default_is("as identified", "FLOAT")
    ] = None
    """Encoder clock minus pose clock [s]."""
    bag: Bag = field(default_factory=BagOptions)
    """Topics to read from a bag."""
    table: TableLayout = field(default_factory=LayoutOptions)
    """Names and units of a table's columns."""
    max_memory: MaxMemory = None
    """Most memory for what the log unpacks to, such as 8GB; a log that needs more is refused."""
    rrd: bool = False
    """Also record measured and predicted paths of up to 20 drives for the rerun viewer, in
    OUT/recordings.
    """
    out: Path = Path("out/evaluate")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figures as PDF."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Needs(("ground", "inputs", "free"), "robot"),
        Needs(("free",), "folds"),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        refuse_same_logs(self.logs)
        require(len(set(self.law)) == len(self.law), "law", self.law, "all different")
        check_sensor(self.sensor, "turning centre")
