"""Options of `trackslip localize`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from experiments.options.bag_choice import BagOptions, plate_of
from experiments.options.help import default_is
from trackslip.ros.choice import BagChoice

_CLEAR = "where the bag leaves no doubt"


@dataclass(frozen=True)
class LocalizeConfig:
    """Find the plate on a robot in the scans of a laser range finder beside the field, and write its poses as a log."""

    path: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="BAG")]
    """A .bag, .mcap or .db3 file, or a folder of bags."""
    plate: Annotated[str, tyro.conf.arg(metavar="LENGTHxTHICKNESS")]
    """Size of the plate, as in 0.5x0.02 [m]."""
    scan: Annotated[str | None, default_is("the only one", "TOPIC")] = None
    """Topic of sensor_msgs/LaserScan of the scanner."""
    mount: Annotated[tuple[float, float, float] | None, default_is("by transforms, else 0 0 0", "X Y YAW")] = None
    """Pose of the scanner in the frame of the poses [m, m, rad]."""
    noise: Annotated[float | None, default_is("found", "FLOAT")] = None
    """Standard deviation of the scanner's ranges [m]."""
    poses: Annotated[str | None, default_is("none", "TOPIC")] = None
    """Topic of other poses, or tf:PARENT:CHILD, by which to find the pose of the scanner in their frame."""
    encoders: Annotated[str | None, default_is(_CLEAR, "TOPIC")] = None
    """Topic of sensor_msgs/JointState with the wheels or sprockets."""
    left: Annotated[str | None, default_is("by their names", "NAMES")] = None
    """Names of the joints on the left, separated by commas; their mean is used."""
    right: Annotated[str | None, default_is("by their names", "NAMES")] = None
    """The same on the right."""
    reversed: Annotated[Literal["left", "right", "both"] | None, default_is("none", "{left,right,both}")] = None
    """Which encoders count backwards."""
    out: Path = Path("out/localize")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figure as PDF."""

    def __post_init__(self) -> None:
        plate_of(self.plate)
        self.choice()

    def choice(self) -> BagChoice:
        """What to take from the bag."""
        names = ("encoders", "left", "right", "reversed", "poses", "plate", "scan", "mount", "noise")
        return BagOptions(**{name: getattr(self, name) for name in names}).choice()
