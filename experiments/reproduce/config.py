"""The options of `trackslip reproduce`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from experiments.simulate.grid_options import GridConfig
from trackslip.errors import InvalidValueError

EXAMPLES: Final = (
    ("the whole paper", "trackslip reproduce"),
    ("with other random numbers", "trackslip reproduce --seed 1 --out out/reproduce-1"),
    ("on another ground", "trackslip reproduce --ground clay --out out/reproduce-clay"),
)
ESSENTIAL: Final = (
    "robot",
    "ground.source",
    "radii",
    "speeds",
    "seed",
    "rrd",
    "pdf",
    "out",
    "overwrite",
)


@dataclass(frozen=True)
class Config(GridConfig):
    """Reproduce the whole paper: the grid, the slip laws identified from its scans, and both
    controllers with and without compensation.
    """

    out: Path = Path("out/reproduce")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figures as PDF."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.radii) < 2:
            raise InvalidValueError(
                "radii", self.radii, "at least two: slip laws are functions of radius"
            )
        if len(self.radii) * len(self.speeds) < 3:
            raise InvalidValueError(
                "speeds", self.speeds, "at least two for two radii: three runs or more"
            )
