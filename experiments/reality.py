"""`trackslip reality`: logs of real robots against laws and the simulator."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from experiments.common.options import ResultsOptions, Whole
from experiments.simulate.options import MAX_THREADS
from trackslip.errors import InvalidValueError

EXAMPLES = (
    ("all shipped logs", "trackslip reality"),
    ("a robot on ice", "trackslip reality ice"),
    ("your robot", "trackslip reality my_robot.toml"),
)


@dataclass(frozen=True)
class Config(ResultsOptions):
    """Predict the motion of real robots on parts of their logs held out: without a fit, by slip laws, by the simulator.

    It ends with 1 if a bound of a data set doesn't hold.
    """

    dataset: tyro.conf.Positional[Annotated[tuple[str, ...], tyro.conf.arg(metavar="[DATASET ...]")]] = ()
    """Data sets, by default all shipped ones: maxxii, husky, warthog, ice, grass, or .toml files of your own."""
    threads: Annotated[int, Whole(0, MAX_THREADS)] = 0
    """Number of worker threads, 0 for one per processor; the results don't depend on it."""
    out: Path = Path("out/reality")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figures as PDF."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len({Path(name).stem for name in self.dataset}) < len(self.dataset):
            raise InvalidValueError("dataset", self.dataset, "of different names")


def run(config: Config) -> None:
    """Fit, simulate, check, report and print."""
    from experiments.common.manifest import command_line
    from experiments.common.results import REPORT_FILE
    from experiments.common.run import Run
    from experiments.evaluate.reality import Findings, findings, load_data_set, shipped
    from experiments.evaluate.reality_page import suite

    names = config.dataset or tuple(shipped())
    if not names:
        raise InvalidValueError(
            "dataset", (), "a .toml file: the shipped data sets are in the source, not in the wheel"
        )
    for name in names:
        load_data_set(name)
    with Run(config) as run, run.progress("reality", len(names), "data sets") as step:
        known: dict[str, Findings] = {}
        found = []
        for name in names:
            with run.watch.stage(name):
                found.append(findings(name, known, config.threads))
            step(1.0)
        result = suite(found)
        manifest = run.manifest(**result.about)
        result.page(manifest, command_line("reality")).write(run.folder, config.pdf)
        run.write(result.to_json(), manifest=manifest)
    result.print()
    print(f"{config.out / REPORT_FILE}: {run.wall:.1f} s")
    if not all(check.holds for check in result.checks):
        sys.exit(1)
