"""The options of `trackslip identify`."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar, Final, Literal

import tyro

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
    Excludes,
    Exclusion,
    NonNegative,
    Positive,
    ResultsOptions,
    Within,
    default_is,
)
from experiments.simulate.options import Method
from trackslip.identification.source import MULTIPLIERS
from trackslip.kinematics import GEARS
from trackslip.motion.steady import SETTLE

EXAMPLES: Final = (
    ("from a stored grid", "trackslip identify out/grid"),
    (
        "from a real robot's log",
        "trackslip identify a.csv --half-gauge 0.2 --sprocket-radius 0.1 --out out/a",
    ),
    (
        "from a ROS bag",
        "trackslip identify b.mcap --half-gauge 0.2 --sprocket-radius 0.1 --out out/b",
    ),
    (
        "from some runs of a sweep",
        "trackslip identify out/500 --where ground=ice --out out/ice-law",
    ),
    (
        "from a drive, with a sensor 0.3 m ahead",
        "trackslip identify out/wander --sensor 0.3 0 0 --out out/drive-law",
    ),
    (
        "two grounds, and whether one law serves both",
        "trackslip identify out/stone out/ice --out out/grounds",
    ),
    ("as in the paper", "trackslip identify out/grid --motion paper --out out/identify-paper"),
)
ESSENTIAL: Final = (
    "logs",
    "half_gauge",
    "sprocket_radius",
    "where",
    "sensor",
    "method",
    "all",
    "table.columns",
    "bag.poses",
    "out",
    "overwrite",
)


@dataclass(frozen=True)
class Config(ResultsOptions):
    """Fit the slip laws to a stored grid or to the log of a real robot, and print and report them.

    A log is a ROS bag, or has the columns run, t, omega_l, omega_r, x, y, phi (any driving) or
    omega_l, omega_r, v, w (steady samples).
    """

    logs: Annotated[
        tyro.conf.Positional[tuple[Path, ...]],
        tyro.conf.arg(metavar="LOG [LOG ...]", help_behavior_hint="(required)"),
    ]
    """Folder of a stored grid, a .csv or .parquet log, or a ROS bag (.bag, .mcap, .db3, or a folder
    of them). Several logs are identified each by itself and compared.
    """
    where: Annotated[
        tuple[str, ...] | None, Distinct("NAME=VALUE"), default_is("all", "NAME=VALUE ...")
    ] = None
    """Use only the runs of a sweep with these values, as in ground=ice friction_ratio=1.2."""
    half_gauge: Annotated[float | None, Positive(100.0, "m"), default_is("the log's", "FLOAT")] = (
        None
    )
    """Half the distance between the tracks [m]."""
    sprocket_radius: Annotated[
        float | None, Positive(100.0, "m"), default_is("the log's", "FLOAT")
    ] = None
    """Radius of the sprockets [m]."""
    gear: Annotated[float, Within(*GEARS)] = 1.0
    """Encoder revolutions per sprocket revolution, if omega is the encoder's speed [-]."""
    multiplier: Annotated[float | None, Within(*MULTIPLIERS), default_is("none", "FLOAT")] = None
    """wheel_separation_multiplier of the odometry that is used instead of encoders [-]."""
    method: Annotated[
        Literal["steady", "drive"] | None,
        default_is("steady where most of the driving is", "{steady,drive}"),
    ] = None
    """Data to fit: stretches of constant sprocket speeds, or whole drives."""
    sensor: Annotated[tuple[float, float, float] | None, default_is("estimated", "X Y YAW")] = None
    """Position of the pose sensor, ahead of and left of the middle of the tracks, and its heading
    [m, m, rad].
    """
    motion: Method = None
    """Method to estimate the twist of a run; bundle needs ranges (see grid)."""
    settle: Annotated[float, NonNegative(3600.0, "s")] = SETTLE
    """Time that is left out of each run after its sprockets become steady [s]."""
    lag: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Also estimate from whole drives the time by which the motion lags behind the belts."""
    all: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Also print the tables with every law."""
    bag: Bag = field(default_factory=BagOptions)
    """Topics to read from a bag."""
    table: TableLayout = field(default_factory=LayoutOptions)
    """Names and units of a table's columns."""
    max_memory: MaxMemory = None
    """Most memory for what the log unpacks to, such as 8GB; a log that needs more is refused."""
    out: Path = Path("out/identify")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figures as PDF."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Excludes(("motion", "settle"), "method", ("drive",)),
        Excludes(("sensor", "lag"), "method", ("steady",)),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        refuse_same_logs(self.logs)
        check_sensor(self.sensor)
