"""Options for commands that drive a grid."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from experiments.common.options import Distinct, Positive, Within
from experiments.simulate.options import (
    MAX_DURATION,
    MAX_RADIUS,
    MIN_DURATION,
    Localization,
    Method,
    Simulation,
    require_speed,
)
from sim.motors.motor import Drive
from trackslip.paper import COMMANDED_RADII, SPEEDS


@dataclass(frozen=True)
class GridConfig(Simulation):
    """A grid of runs with constant commands, radius x speed, in front of the scanner."""

    radii: Annotated[tuple[float, ...], Distinct("number"), Positive(MAX_RADIUS)] = COMMANDED_RADII
    """Commanded radii of left turns, for tracks without slip [m]."""
    speeds: Annotated[tuple[float, ...], Distinct("number")] = SPEEDS
    """Commanded speeds, for tracks without slip [m/s]."""
    localization: Localization = "plate"
    """Pose estimation from scans: maximum likelihood with the known plate, or the paper's line
    fit.
    """
    duration: Annotated[float, Within(MIN_DURATION, MAX_DURATION, "s")] = 30.0
    """Length of each run [s]."""
    motion: Method = None
    """Twist estimation from a run: the paper's filter, an arc through all poses, or all ranges."""
    random_phase: bool = False
    """Start each run at a random point of its circle instead of the point nearest to the
    scanner.
    """
    out: Path = Path("out/grid")
    """Folder for the results."""

    def check(self, drive: Drive) -> None:
        """Raise InvalidValueError for options that the robot's drive does not allow."""
        super().check(drive)
        for speed in self.speeds:
            require_speed("speeds", speed, drive.top_speed)
