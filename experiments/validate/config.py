"""The options of `trackslip validate`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

from experiments.common.choices import ROBOTS
from experiments.common.options import Excludes, Exclusion, default_is
from experiments.simulate.options import Repeatable

EXAMPLES = (
    ("the shipped robot", "trackslip validate"),
    ("a calibrated robot", "trackslip validate --robot out/calibrate/robot.toml"),
    ("tracks on terrain", "trackslip validate --terrain"),
    ("ground that shears", "trackslip validate --shear"),
)


@dataclass(frozen=True)
class Config(Repeatable):
    """Compare the simulator with theory: turning, loads, slopes, time step, solver, energy.

    With --terrain it is tracks made with sim.tracks, on a box and the rescue robot: turning, climbing, tipping over,
    stairs, rough ground.
    """

    robot: Annotated[str | None, default_is("shipped; with --terrain, a box and rescue", ROBOTS)] = None
    """Robot: a name, a file of parameters as written by calibrate, or of a model (MJCF, URDF) with its tracks."""
    terrain: bool = False
    """Instead compare tracks on terrain with theory, and check their bounds."""
    shear: bool = False
    """Instead compare ground that shears with theory, under two robots or --robot, and check its bounds."""
    rrd: bool = False
    """Also record the robot turning at the paper's radii, for the rerun viewer, in OUT/recordings."""
    out: Path = Path("out/validate")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figures as PDF."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Excludes(("shear", "rrd"), "terrain"),
        Excludes(("rrd",), "shear"),
    )
