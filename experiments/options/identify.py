"""Options of `trackslip identify`."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from experiments.options.bag_choice import Bag, BagOptions
from experiments.options.checks import refuse_unused, require_between, require_distinct, require_positive_up_to
from experiments.options.help import default_is
from experiments.options.world import Method
from trackslip.errors import InvalidValueError, require_non_negative
from trackslip.motion.constant_speed import SETTLE

_SHOWN = tyro.conf.arg(help_behavior_hint="(default: where the driving shows it)")
_MAX_LEVER = 100.0  # [m]


@dataclass(frozen=True)
class IdentifyConfig:
    """Fit the slip laws to a stored grid or to the log of a real robot, and print and report them.

    A log is a ROS bag, or has the columns run, t, omega_l, omega_r, x, y, phi (any driving) or omega_l, omega_r, v, w
    (steady samples).
    """

    path: tyro.conf.Positional[Path]
    """Folder of a stored grid, a .csv or .parquet log, or a ROS bag (.bag, .mcap, .db3, or a folder of them)."""
    where: Annotated[tuple[str, ...] | None, default_is("all", "NAME=VALUE ...")] = None
    """Which runs of a sweep to use: ground=ice friction_ratio=1.2."""
    half_gauge: Annotated[float | None, default_is("the log's", "FLOAT")] = None
    """Half the distance between the tracks [m]."""
    sprocket_radius: Annotated[float | None, default_is("the log's", "FLOAT")] = None
    """Radius of the sprockets [m]."""
    gear: float = 1.0
    """Encoder revolutions per sprocket revolution, if omega is the encoder's speed [-]."""
    method: Annotated[
        Literal["steady", "drive"] | None, default_is("steady where most of the driving is", "{steady,drive}")
    ] = None
    """What the laws are fitted to: stretches of constant sprocket speeds, or whole drives."""
    sensor: Annotated[tuple[float, float, float] | None, default_is("estimated", "X Y YAW")] = None
    """Place of the poses' sensor, ahead of and left of the middle of the tracks, and its heading there [m, m, rad]."""
    estimate_sensor: Annotated[bool | None, _SHOWN] = None
    """Whether steady stretches tell where the sensor sits; whole drives always do unless --sensor is given."""
    motion: Method = None
    """How a twist is estimated from a run; bundle needs ranges (see grid)."""
    settle: float = SETTLE
    """Time left out of each run after the sprockets have become steady [s]."""
    bag: Bag = field(default_factory=BagOptions)
    """What to take from a bag."""
    out: Path = Path("out/identify")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figures as PDF."""

    def __post_init__(self) -> None:
        require_distinct("where", self.where, "NAME=VALUE")
        require_positive_up_to("half_gauge", self.half_gauge, 100.0, "m")
        require_positive_up_to("sprocket_radius", self.sprocket_radius, 100.0, "m")
        require_positive_up_to("gear", self.gear, 1e4)
        require_non_negative("settle", self.settle)
        if self.sensor is not None:
            self._check_sensor(*self.sensor)
        if self.method == "drive":
            refuse_unused(self, ("motion", "settle", "estimate_sensor"), "with --method drive")

    def _check_sensor(self, x: float, y: float, yaw: float) -> None:
        require_between("sensor", x, -_MAX_LEVER, _MAX_LEVER, "m, ahead of the middle of the tracks")
        require_between("sensor", y, -_MAX_LEVER, _MAX_LEVER, "m, left of the middle of the tracks")
        require_between("sensor", yaw, -math.pi, math.pi, "rad, counter-clockwise")
        if self.estimate_sensor:
            raise InvalidValueError("estimate_sensor", True, "left out where --sensor is given")
