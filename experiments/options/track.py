"""Options of `trackslip track`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from experiments.options.checks import refuse_unused, require_between, require_speed
from experiments.options.choices import COMPENSATIONS, CONTROLLERS, REFERENCES, WITHOUT_LAWS
from experiments.options.help import default_is
from experiments.options.world import MAX_COORDINATE, MAX_DURATION, MAX_PREVIEW, MAX_RADIUS, Simulation


@dataclass(frozen=True)
class TrackConfig(Simulation):
    """Follow a path once in closed loop, localizing with the scanner, and print the errors."""

    controller: Annotated[str, tyro.conf.arg(metavar=CONTROLLERS)] = "linear"
    """Controller: linear is the paper's Eq. 31, ppo:FOLDER a policy of train, MODULE:CLASS your own."""
    compensation: Annotated[str, tyro.conf.arg(metavar=COMPENSATIONS)] = "icr_radius"
    """Slip compensation: LAW of --laws; online starts from icr_radius, online_load icr_load, online_cold no slip."""
    preview: float = 0.0
    """Time by which the controller looks ahead on the path; 0.075 s makes up for the lag of servo and sampling [s]."""
    localization: Literal["plate", "line", "truth"] = "plate"
    """How the controller learns its pose: from scans by the plate or the line method, or the true pose."""
    reference: Annotated[str, tyro.conf.arg(metavar=REFERENCES)] = "paper"
    """Path: the paper's takes 45.8 s, circle is in front of the scanner, a .csv file has way points x, y [m]."""
    circle_radius: float = 1.25
    """Radius of the circle, to the left; needs --reference circle [m]."""
    circle_speed: float = 0.15
    """Speed on the circle; needs --reference circle [m/s]."""
    circle_duration: float = 45.0
    """Time on the circle; needs --reference circle [s]."""
    start: Annotated[
        tuple[float, float, float] | None,
        default_is("0.3 -0.2 1.0472, as in the paper, for linear on the paper's path; else the reference's", "X Y PHI"),
    ] = None
    """Start pose [m, m, rad]."""
    laws: Annotated[Path | None, default_is("the laws shipped with trackslip", "PATH")] = None
    """Identified laws: a summary.json, or a folder that contains one."""
    bag: bool = False
    """Also write a ROS 2 bag to OUT/bags."""
    out: Path = Path("out/track")
    """Folder for the results."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_between("preview", self.preview, 0, MAX_PREVIEW, "s")
        require_speed("circle_speed", self.circle_speed, self.drive.top_speed)
        require_between("circle_duration", self.circle_duration, 1.0, MAX_DURATION, "s")
        require_between("circle_radius", self.circle_radius, 0.1, MAX_RADIUS, "m")
        if self.reference != "circle":
            refuse_unused(self, ("circle_radius", "circle_speed", "circle_duration"), "without --reference circle")
        if self.compensation in WITHOUT_LAWS:
            refuse_unused(self, ("laws",), f"with --compensation {self.compensation}")
        for value in self.start or ():
            require_between("start", value, -MAX_COORDINATE, MAX_COORDINATE)
