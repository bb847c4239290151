"""Options of `trackslip validate`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from experiments.options.world import Repeatable


@dataclass(frozen=True)
class ValidateConfig(Repeatable):
    """Hold the simulator against theory: turning, loads, slopes, step length, solver, energy."""

    robot: Path | None = None
    """A robot file, as calibrate writes it; by default the shipped robot."""
    rrd: bool = False
    """Also let the robot turn with the paper's radii, recorded for the rerun viewer in OUT/recordings."""
    out: Path = Path("out/validate")
    """Folder for the results."""
    pdf: bool = False
    """Write the figures as PDF, too."""
