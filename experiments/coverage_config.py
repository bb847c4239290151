"""Options of `trackslip coverage`."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path

from experiments.config import GridConfig
from trackslip.errors import InvalidValueError

MOST_REPEATS = 100_000


@dataclass(frozen=True)
class CoverageConfig(GridConfig):
    """Whether the 95 % intervals hold the truth in 95 % of many repeats: of samples drawn from each law with the
    errors that the grid's own runs have, and of the grid's runs scanned again with other noise."""

    repeats: int = 1000
    """Sets of samples drawn from each law."""
    run_repeats: int = 200
    """Times that the grid's runs are scanned anew; 0 for none."""
    out: Path = Path("out/coverage")
    """Folder for the results."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.repeats <= MOST_REPEATS:
            raise InvalidValueError("repeats", self.repeats, f"an integer from 1 to {MOST_REPEATS}")
        if not 0 <= self.run_repeats <= MOST_REPEATS:
            raise InvalidValueError("run_repeats", self.run_repeats, f"an integer from 0 to {MOST_REPEATS}")
        if self.scanner.noise <= 0:
            raise InvalidValueError("scanner.noise", self.scanner.noise, "greater than 0: without it nothing is random")
        if len(self.radii) * len(self.speeds) < 4 or len(self.radii) < 2:
            raise InvalidValueError("radii", self.radii, "at least two, and four runs or more")

    def without_noise(self) -> GridConfig:
        """The grid as a perfect scanner would see it."""
        shared = {field.name: getattr(self, field.name) for field in fields(GridConfig)}
        return GridConfig(**shared | {"scanner": replace(self.scanner, noise=0.0)})
