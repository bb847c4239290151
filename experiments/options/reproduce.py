"""Options of `trackslip reproduce`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from experiments.options.grid import GridConfig
from trackslip.errors import InvalidValueError


@dataclass(frozen=True)
class ReproduceConfig(GridConfig):
    """The whole paper: the grid, the slip laws from its scans, both controllers with and without them."""

    out: Path = Path("out/reproduce")
    """Folder for the results."""
    pdf: bool = False
    """Write the figures as PDF, too."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.radii) < 2:
            raise InvalidValueError("radii", self.radii, "at least two: slip laws are functions of radius")
        if len(self.radii) * len(self.speeds) < 3:
            raise InvalidValueError("speeds", self.speeds, "at least two for two radii: three runs or more")
