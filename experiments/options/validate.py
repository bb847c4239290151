"""Options of `trackslip validate`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from experiments.options.checks import refuse_unused
from experiments.options.help import default_is
from experiments.options.world import Repeatable


@dataclass(frozen=True)
class ValidateConfig(Repeatable):
    """Compare the simulator with theory: turning, loads, slopes, time step, solver, energy.

    With --terrain it is tracks made with sim.tracks, on a box and the rescue robot: turning, climbing, tipping over,
    stairs, rough ground.
    """

    robot: Annotated[Path | None, default_is("the shipped robot", "FILE")] = None
    """Robot file as written by calibrate; with --terrain, a tracked robot's instead of the box and the rescue robot."""
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

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.terrain:
            refuse_unused(self, ("shear", "rrd"), "with --terrain")
        if self.shear:
            refuse_unused(self, ("rrd",), "with --shear")
