"""Options of `trackslip validate`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from experiments.options.help import default_is
from experiments.options.world import Repeatable


@dataclass(frozen=True)
class ValidateConfig(Repeatable):
    """Compare the simulator with theory: turning, loads, slopes, time step, solver, energy."""

    robot: Annotated[Path | None, default_is("the shipped robot", "FILE")] = None
    """Robot file as written by calibrate."""
    rrd: bool = False
    """Also record the robot turning at the paper's radii, for the rerun viewer, in OUT/recordings."""
    out: Path = Path("out/validate")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figures as PDF."""
