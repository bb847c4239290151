"""Options of `trackslip coverage`."""

from dataclasses import dataclass, fields, replace
from pathlib import Path

from experiments.options.checks import default_of, refuse_changed, refuse_unused, require_integer
from experiments.options.grid import GridConfig, RunsConfig
from trackslip.errors import InvalidValueError

MAX_REPEATS = 100_000
_OF_DRIVES = ("drives", "drive_repeats", "seed", "threads", "out")


@dataclass(frozen=True)
class CoverageConfig(RunsConfig):
    """Check that 95 % intervals cover the truth in 95 % of many repeats.

    The repeats are samples drawn from each law, with the errors of the grid's own runs, and the grid's runs scanned
    again with new noise. With --drives they are teleoperated drives, each fitted as a whole.
    """

    repeats: int = 1000
    """Number of sets of samples drawn from each law."""
    run_repeats: int = 400
    """Number of grids that are scanned and fitted."""
    grids: int = 20
    """Number of grids that are driven, from new random points of the circles, for those run_repeats scans."""
    drives: bool = False
    """Instead try the estimator of laws from drives, in the cases that it is made for, and check its errors."""
    drive_repeats: int = 200
    """Number of drives in each case; needs --drives."""
    out: Path = Path("out/coverage")
    """Folder for the results."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_integer("repeats", self.repeats, 1, MAX_REPEATS)
        require_integer("run_repeats", self.run_repeats, 1, MAX_REPEATS)
        require_integer("drive_repeats", self.drive_repeats, 2, MAX_REPEATS)
        if self.drives:
            for option in fields(self):
                if option.name not in _OF_DRIVES:
                    refuse_changed(option.name, getattr(self, option.name), default_of(option), "with --drives")
            return
        refuse_unused(self, ("drive_repeats",), "without --drives")
        if not 1 <= self.grids <= self.run_repeats:
            raise InvalidValueError("grids", self.grids, f"an integer from 1 to run_repeats = {self.run_repeats}")
        if self.scanner.noise <= 0:
            raise InvalidValueError("scanner.noise", self.scanner.noise, "greater than 0: without it nothing is random")
        if len(self.radii) * len(self.speeds) < 4 or len(self.radii) < 2:
            raise InvalidValueError("radii", self.radii, "at least two, and four runs or more")

    def grid(self, number: int) -> GridConfig:
        """The grid of that number, seen by a scanner without noise."""
        shared = {field.name: getattr(self, field.name) for field in fields(RunsConfig)}
        silent = replace(self.scanner, noise=0.0)
        return GridConfig(**shared | {"scanner": silent, "random_phase": True, "seed": self.seed + number})
