"""`trackslip coverage`: do the 95 % intervals cover the truth in 95 % of many repeats?"""

from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Annotated, ClassVar

from experiments.common.options import Excludes, Exclusion, Needs, Whole
from experiments.simulate.grid_options import GridConfig
from trackslip.errors import InvalidValueError

EXAMPLES = (
    ("a thousand repeats", "trackslip coverage"),
    ("fewer", "trackslip coverage --repeats 100 --run-repeats 40 --grids 4"),
    ("laws from teleoperated drives", "trackslip coverage --drives"),
)
_MAX_REPEATS = 100_000
_OF_GRIDS = tuple(option.name for option in fields(GridConfig) if option.name not in ("seed", "threads"))


@dataclass(frozen=True)
class Config(GridConfig):
    """Check that 95 % intervals cover the truth in 95 % of many repeats.

    The repeats are samples drawn from each law, with the errors of the grid's own runs, and the grid's runs scanned
    again with new noise. With --drives they are teleoperated drives, each fitted as a whole. An interrupted study
    resumes: repeats that are already stored in OUT are not done again.
    """

    repeats: Annotated[int, Whole(1, _MAX_REPEATS)] = 1000
    """Number of sets of samples drawn from each law."""
    run_repeats: Annotated[int, Whole(1, _MAX_REPEATS)] = 400
    """Number of grids that are scanned and fitted."""
    grids: Annotated[int, Whole(1)] = 20
    """Number of grids that are driven, from new random points of the circles, and shared by the --run-repeats."""
    drives: bool = False
    """Check the fits of whole drives instead, for each source of poses and kind of driving."""
    drive_repeats: Annotated[int, Whole(2, _MAX_REPEATS)] = 200
    """Number of drives in each case; needs --drives."""
    out: Path = Path("out/coverage")
    """Folder for the results."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Needs(("drive_repeats",), "drives"),
        Excludes((*_OF_GRIDS, "repeats", "run_repeats", "grids"), "drives"),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.grids > self.run_repeats:
            raise InvalidValueError("grids", self.grids, f"at most run_repeats = {self.run_repeats}")
        if self.scanner.noise <= 0:
            raise InvalidValueError("scanner.noise", self.scanner.noise, "greater than 0: without it nothing is random")
        if len(self.radii) * len(self.speeds) < 4 or len(self.radii) < 2:
            raise InvalidValueError("radii", self.radii, "at least two, and four runs or more")

    def grid(self, number: int) -> GridConfig:
        """The grid of that number, seen by a scanner without errors."""
        shared = {option.name: getattr(self, option.name) for option in fields(GridConfig)}
        return GridConfig(**shared | {"scanner": self.scanner.ideal, "random_phase": True, "seed": self.seed + number})


def run(config: Config) -> None:
    """Check the intervals of steady samples, or those of drives; store and print."""
    from experiments.common.results import SUMMARY_FILE
    from experiments.common.run import Run
    from experiments.recorder import record_all
    from experiments.simulate.grid_runs import drive_grid
    from experiments.simulate.world import World
    from experiments.studies.drive_coverage import drive_study
    from experiments.studies.steady_coverage import steady_coverage
    from experiments.studies.trials import forget_trials

    with Run(config, partial(forget_trials, config.out)) as run:
        world = World.of(config if config.drives else config.grid(0))
        study = (drive_study if config.drives else steady_coverage)(config, world, run)
        run.write(study.to_json(), **world.about)
        if config.rrd:
            record_all(run.folder, drive_grid(config.grid(0), world))
    study.print()
    print(f"{config.out / SUMMARY_FILE}: {run.wall:.1f} s")
