"""Options of `trackslip calibrate`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from experiments.options.checks import require_distinct, require_integer
from experiments.options.help import default_is
from experiments.options.world import Repeatable
from trackslip.errors import InvalidValueError

Parameter = Literal["half_gauge", "contact_length", "friction_ratio", "radius_error", "com_x", "com_y", "shear"]
MAX_STARTS = 100


@dataclass(frozen=True)
class CalibrateConfig(Repeatable):
    """Fit the simulated robot's parameters to slips and radii: the paper's, or those of a log.

    A table of turns has the columns radius and speed (commanded, to the left), observed_radius, slip_outer, slip_inner.
    """

    target: Annotated[str, default_is("published", "published|FILE")] = "published"
    """What to fit: Eq. 11 and the radii of Fig. 5 (published), a log or folder for identify, or a .csv table."""
    free: tuple[Parameter, ...] = ("friction_ratio", "radius_error", "com_y")
    """Parameters to fit; friction_ratio is across / along, shear the modulus of ground that shears."""
    robot: Annotated[Path | None, default_is("the shipped robot", "FILE")] = None
    """Robot file with the initial values, and with the values of the parameters that are not fitted."""
    starts: int = 5
    """Number of random starts in addition to the robot's own values."""
    rrd: bool = False
    """Also record the calibrated robot turning at the paper's radii, for the rerun viewer, in OUT/recordings."""
    out: Path = Path("out/calibrate")
    """Folder for the results, including robot.toml."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.target:
            raise InvalidValueError("target", self.target, "published, or a file")
        require_distinct("free", self.free, "parameter")
        require_integer("starts", self.starts, 0, MAX_STARTS)
