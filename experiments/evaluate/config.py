"""The options of `trackslip evaluate`."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from experiments.common.log_options import Bag, BagOptions, check_sensor
from experiments.common.options import Distinct, Positive, ResultsOptions, Within, default_is
from trackslip.errors import InvalidValueError
from trackslip.kinematics import GEARS

EXAMPLES = (
    ("a law and no compensation", "trackslip evaluate out/wander --law out/identify --law none"),
    ("on a robot's log", "trackslip evaluate log.csv --law out/mine --law none"),
    ("of two laws, on a ROS bag", "trackslip evaluate run.mcap --law out/mine:icr --law out/mine:turn_loss"),
)


_LOGS = default_is("the log's, or the laws'", "FLOAT")
_LAWS = "as identified with the laws"
_MAX_OFFSET = 3600.0  # [s]


@dataclass(frozen=True)
class Config(ResultsOptions):
    """Measure the errors of odometry with slip laws on a log: absolute ones, and relative ones per metre and second.

    The log is one that identify reads; it should not be the one that the laws were identified from.
    """

    path: tyro.conf.Positional[Path]
    """Folder of a stored drive or grid, a .csv or .parquet log, or a ROS bag (.bag, .mcap, .db3, or their folder)."""
    law: Annotated[
        tuple[str, ...],
        tyro.conf.UseAppendAction,
        tyro.conf.arg(metavar="LAW", help_behavior_hint="(default: none; may be repeated)"),
    ] = ()
    """A law for odometry: none, an identification's folder (its best law), a file of laws, or either with :NAME."""
    where: Annotated[tuple[str, ...] | None, Distinct("NAME=VALUE"), default_is("all", "NAME=VALUE ...")] = None
    """Runs of a sweep to use: ground=ice friction_ratio=1.2."""
    half_gauge: Annotated[float | None, Positive(100.0, "m"), _LOGS] = None
    """Half the distance between the tracks [m]."""
    sprocket_radius: Annotated[float | None, Positive(100.0, "m"), _LOGS] = None
    """Radius of the sprockets [m]."""
    gear: Annotated[float, Within(*GEARS)] = 1.0
    """Encoder revolutions per sprocket revolution, if omega is the encoder's speed [-]."""
    sensor: Annotated[tuple[float, float, float] | None, default_is(_LAWS, "X Y YAW")] = None
    """Place of the poses' sensor, ahead and to the left of the turning centre, and its heading there [m, m, rad]."""
    clock_offset: Annotated[float | None, Within(-_MAX_OFFSET, _MAX_OFFSET, "s"), default_is(_LAWS, "FLOAT")] = None
    """Encoder clock minus pose clock [s]."""
    bag: Bag = field(default_factory=BagOptions)
    """Topics to read from a bag."""
    tum: bool = True
    """Write measured and estimated trajectories to OUT/trajectories, in the TUM format that evo reads."""
    out: Path = Path("out/evaluate")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figures as PDF."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(set(self.law)) < len(self.law):
            raise InvalidValueError("law", self.law, "all different")
        check_sensor(self.sensor, "turning centre")
