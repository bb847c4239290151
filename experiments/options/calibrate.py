"""Options of `trackslip calibrate`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from experiments.options.world import Repeatable
from trackslip.errors import InvalidValueError

Parameter = Literal["half_gauge", "contact_length", "friction_ratio", "radius_error", "com_x", "com_y"]
MAX_STARTS = 100


@dataclass(frozen=True)
class CalibrateConfig(Repeatable):
    """Tune the simulated robot to slips and radii: the paper's, or those of a log."""

    target: str = "published"
    """published (Eq. 11 and the radii of Fig. 5), or a file: a log or folder that identify takes, or a table .csv with
    radius, speed (commanded, to the left), observed_radius, slip_outer, slip_inner."""
    free: tuple[Parameter, ...] = ("friction_ratio", "radius_error", "com_y")
    """What may change; friction_ratio is across / along."""
    robot: Path | None = None
    """A robot file with the values to start from and those that are not free; by default the shipped robot."""
    starts: int = 5
    """Random starts besides the robot's own values."""
    rrd: bool = False
    """Also let the calibrated robot turn with the paper's radii, recorded for the rerun viewer in OUT/recordings."""
    out: Path = Path("out/calibrate")
    """Folder for the results, robot.toml among them."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.target:
            raise InvalidValueError("target", self.target, "published, or a file")
        if not self.free:
            raise InvalidValueError("free", self.free, "at least one parameter")
        if not 0 <= self.starts <= MAX_STARTS:
            raise InvalidValueError("starts", self.starts, f"an integer from 0 to {MAX_STARTS}")
