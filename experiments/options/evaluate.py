"""Options of `trackslip evaluate`."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from experiments.options.bag_choice import Bag, BagOptions
from experiments.options.checks import require_between, require_distinct, require_positive_up_to
from experiments.options.help import default_is
from trackslip.errors import InvalidValueError

_MAX_LEVER = 100.0  # [m]
_MAX_OFFSET = 3600.0  # [s]


@dataclass(frozen=True)
class EvaluateConfig:
    """Measure how far odometry by slip laws is off on a log: absolute errors, and relative ones per metre and second.

    The log is one that identify reads; it should not be the one that the laws were identified from.
    """

    path: tyro.conf.Positional[Path]
    """Folder of a stored drive or grid, a .csv or .parquet log, or a ROS bag (.bag, .mcap, .db3, or their folder)."""
    law: Annotated[
        tuple[str, ...],
        tyro.conf.UseAppendAction,
        tyro.conf.arg(metavar="LAW", help_behavior_hint="(default: none; may be repeated)"),
    ] = ()
    """A law to reckon with: none, an identification's folder (its best law), a file of laws, or either with :NAME."""
    where: Annotated[tuple[str, ...] | None, default_is("all", "NAME=VALUE ...")] = None
    """Which runs of a sweep to use: ground=ice friction_ratio=1.2."""
    half_gauge: Annotated[float | None, default_is("the log's, or the laws'", "FLOAT")] = None
    """Half the distance between the tracks [m]."""
    sprocket_radius: Annotated[float | None, default_is("the log's, or the laws'", "FLOAT")] = None
    """Radius of the sprockets [m]."""
    gear: float = 1.0
    """Encoder revolutions per sprocket revolution, if omega is the encoder's speed [-]."""
    sensor: Annotated[tuple[float, float, float] | None, default_is("as identified with the laws", "X Y YAW")] = None
    """Place of the poses' sensor, ahead and to the left of the turning centre, and its heading there [m, m, rad]."""
    clock_offset: Annotated[float | None, default_is("as identified with the laws", "FLOAT")] = None
    """Encoder clock minus pose clock [s]."""
    bag: Bag = field(default_factory=BagOptions)
    """What to take from a bag."""
    tum: bool = True
    """Whether to write measured and estimated trajectories to OUT/trajectories, in the TUM format that evo reads."""
    out: Path = Path("out/evaluate")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figures as PDF."""

    def __post_init__(self) -> None:
        require_distinct("where", self.where, "NAME=VALUE")
        if len(set(self.law)) < len(self.law):
            raise InvalidValueError("law", self.law, "all different")
        require_positive_up_to("half_gauge", self.half_gauge, 100.0, "m")
        require_positive_up_to("sprocket_radius", self.sprocket_radius, 100.0, "m")
        require_positive_up_to("gear", self.gear, 1e4)
        if self.sensor is not None:
            for value, where in zip(self.sensor, ("ahead of", "left of"), strict=False):
                require_between("sensor", value, -_MAX_LEVER, _MAX_LEVER, f"m, {where} the turning centre")
            require_between("sensor", self.sensor[2], -math.pi, math.pi, "rad, counter-clockwise")
        if self.clock_offset is not None:
            require_between("clock_offset", self.clock_offset, -_MAX_OFFSET, _MAX_OFFSET, "s")
