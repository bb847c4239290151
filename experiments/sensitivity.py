"""`trackslip sensitivity`: how disturbances of scanner, mounting and field affect the identified slip."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from experiments.simulate.grid_options import GridConfig
from sim.scanner.scanner import MIRROR_PERIOD
from trackslip.errors import InvalidValueError

EXAMPLES = (
    ("the paper's grid", "trackslip sensitivity"),
    ("a smaller one", "trackslip sensitivity --radii 0.5 1.5 --speeds 0.1 0.2 --duration 20"),
)


@dataclass(frozen=True)
class Config(GridConfig):
    """Drive the grid repeatedly, each time with another disturbance of the scanner, its mounting or the field, and
    print the slip errors it causes.

    An interrupted study resumes: grids that are already evaluated in OUT are not driven again.
    """

    out: Path = Path("out/sensitivity")
    """Folder for the results."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.scanner.period < MIRROR_PERIOD:
            allowed = f"at most {1 / MIRROR_PERIOD:g} Hz, to leave time for the scan duration that is tried"
            raise InvalidValueError("scanner.rate", self.scanner.rate, allowed)


def run(config: Config) -> None:
    """Drive, evaluate, store and print."""
    from experiments.common.results import SUMMARY_FILE
    from experiments.common.run import Run
    from experiments.recorder import record_all
    from experiments.simulate.world import World
    from experiments.studies.sensitivity import examples, sensitivity
    from experiments.studies.trials import forget_trials

    with Run(config, partial(forget_trials, config.out)) as run:
        study = sensitivity(config, run)
        run.write(study.to_json(), **World.of(config).about)
        if config.rrd:
            with run.busy("recordings"):
                record_all(run.folder, examples(config))
    study.print()
    print(f"{config.out / SUMMARY_FILE}: {run.wall:.1f} s")
