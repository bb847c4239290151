"""Options of `trackslip coverage`."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path

from experiments.options.grid import GridConfig
from trackslip.errors import InvalidValueError

MAX_REPEATS = 100_000


@dataclass(frozen=True)
class CoverageConfig(GridConfig):
    """Whether the 95 % intervals hold the truth in 95 % of many repeats: of samples drawn from each law with the
    errors that the grid's own runs have, and of the grid's runs scanned again with other noise."""

    repeats: int = 1000
    """Sets of samples drawn from each law."""
    run_repeats: int = 400
    """Grids scanned and fitted."""
    drives: int = 20
    """Times that the grid is driven for that, each from other phases of the circles; each drive is scanned anew
    run_repeats / drives times."""
    out: Path = Path("out/coverage")
    """Folder for the results."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.repeats <= MAX_REPEATS:
            raise InvalidValueError("repeats", self.repeats, f"an integer from 1 to {MAX_REPEATS}")
        if not 1 <= self.run_repeats <= MAX_REPEATS:
            raise InvalidValueError("run_repeats", self.run_repeats, f"an integer from 1 to {MAX_REPEATS}")
        if not 1 <= self.drives <= self.run_repeats:
            raise InvalidValueError("drives", self.drives, f"an integer from 1 to run_repeats = {self.run_repeats}")
        if self.scanner.noise <= 0:
            raise InvalidValueError("scanner.noise", self.scanner.noise, "greater than 0: without it nothing is random")
        if len(self.radii) * len(self.speeds) < 4 or len(self.radii) < 2:
            raise InvalidValueError("radii", self.radii, "at least two, and four runs or more")

    def grid(self, drive: int) -> GridConfig:
        """The grid of one of the drives, as a perfect scanner would see it."""
        shared = {field.name: getattr(self, field.name) for field in fields(GridConfig)}
        silent = replace(self.scanner, noise=0.0)
        return GridConfig(**shared | {"scanner": silent, "random_phase": True, "seed": self.seed + drive})

    def shares(self) -> list[int]:
        """How often each drive is scanned."""
        return [len(range(drive, self.run_repeats, self.drives)) for drive in range(self.drives)]
