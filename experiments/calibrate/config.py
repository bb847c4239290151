"""The options of `trackslip calibrate`."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar, Final, Literal, get_args

from experiments.common.choices import SHIPPED
from experiments.common.log_options import (
    MAX_CLOCK_OFFSET,
    Bag,
    BagOptions,
    LayoutOptions,
    MaxMemory,
    TableLayout,
    check_sensor,
)
from experiments.common.options import (
    Distinct,
    Excludes,
    Exclusion,
    ResultsOptions,
    Whole,
    Within,
    default_is,
)
from experiments.simulate.options import MAX_THREADS, GroundOptions, RobotSource
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
    "sensor_x",
    "sensor_y",
    "sensor_yaw",
    "clock",
    "lag",
]

Free = Literal[Parameter, "cohesion", "friction_angle"]
"""Parameters of robots and firm ground, and of soft soil."""

OF_TURNS: Final[tuple[Parameter, ...]] = ("friction_ratio", "radius_error", "com_y")
OF_DRIVES: Final[tuple[Parameter, ...]] = (
    "friction",
    "friction_ratio",
    "radius_error",
    "sensor_x",
    "clock",
)
OF_PULLS: Final[tuple[Free, ...]] = ("cohesion", "friction_angle", "shear")
"""Parameters to fit by default: OF_TURNS to steady turns, OF_DRIVES to drives, OF_PULLS to a pull
test.
"""
ROBOT: Final = "robot.toml"
GROUND: Final = "ground.toml"
EXAMPLES: Final = (
    ("to the paper's slips and radii", "trackslip calibrate"),
    (
        "to a log, each half predicted from the other",
        "trackslip calibrate --target log.csv --robot husky --folds 2 --out out/halves",
    ),
    (
        "soft soil, to a table of pulls and slips",
        "trackslip calibrate --target pulls.csv --ground dry_sand --out out/soil",
    ),
    (
        "to commands, with the lag of the servos",
        "trackslip calibrate --target log.csv --free lag clock --out out/lag",
    ),
)
ESSENTIAL: Final = (
    "target",
    "free",
    "robot",
    "ground.source",
    "folds",
    "out",
    "overwrite",
    "gear",
)


@dataclass(frozen=True)
class Config(ResultsOptions):
    """Fit parameters of the simulated robot, its ground, drive and sensor to published slips or to
    a log.

    Any log that identify reads can be used: drives or windows with poses, or steady samples. On
    soft soil, cohesion, friction angle and shear modulus are fitted to a pull test.
    """

    target: Annotated[str, default_is("published", "published|FILE")] = "published"
    """Data: the paper's Eq. 11 and Fig. 5 (published), a log, a ROS bag or a folder; on soft soil a
    table with the columns pull [N] and slip, and weight [N] if it isn't the robot's.
    """
    free: Annotated[
        tuple[Free, ...] | None,
        Distinct("parameter"),
        default_is(
            f"{' '.join(OF_TURNS)}; for drives {' '.join(OF_DRIVES)}; for pulls "
            f"{' '.join(OF_PULLS)}",
            f"{{{','.join(get_args(Free))}}} ...",
        ),
    ] = None
    """Parameters to fit; friction_ratio is across / along, radii are relative errors; lag needs
    commands, cohesion and friction_angle soft soil.
    """
    robot: RobotSource = SHIPPED
    """Robot with the initial values, and with the values of the parameters that are not fitted."""
    ground: GroundOptions = field(default_factory=GroundOptions)
    """Ground with the initial values."""
    gear: Annotated[float, Within(*GEARS)] = 1.0
    """Encoder revolutions per sprocket revolution, if omega is the encoder's speed [-]."""
    sensor: Annotated[tuple[float, float, float] | None, default_is("the middle", "X Y YAW")] = None
    """Position of the pose sensor, ahead of and left of the middle of the tracks, and its heading
    [m, m, rad].
    """
    clock_offset: Annotated[float, Within(-MAX_CLOCK_OFFSET, MAX_CLOCK_OFFSET, "s")] = 0.0
    """Initial encoder clock minus pose clock [s]."""
    bag: Bag = field(default_factory=BagOptions)
    """Topics to read from a bag."""
    table: TableLayout = field(default_factory=LayoutOptions)
    """Names and units of a table's columns."""
    max_memory: MaxMemory = None
    """Most memory for what the log unpacks to, such as 8GB; a log that needs more is refused."""
    folds: Annotated[int | None, Whole(2, 20), default_is("none", "INT")] = None
    """Number of parts of the log, each predicted by a fit to the other parts."""
    test: Annotated[Path | None, default_is("none", "LOG")] = None
    """Another log to predict, for which only the clock offset is fitted."""
    threads: Annotated[int, Whole(0, MAX_THREADS)] = 0
    """Number of worker threads, 0 for one per processor; the results don't depend on it."""
    out: Path = Path("out/calibrate")
    """Folder for the results, including robot.toml and ground.toml."""
    pdf: bool = False
    """Also write the figures as PDF."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Excludes(("test",), "folds"),
        Excludes(
            ("gear", "sensor", "clock_offset", "bag", "table", "max_memory", "folds", "test"),
            "target",
            ("published",),
        ),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_sensor(self.sensor)
