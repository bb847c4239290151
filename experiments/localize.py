"""`trackslip localize`: poses of the plate on a robot from the scans of a stationary laser range finder."""

import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from experiments.common.log_options import BagOptions
from experiments.common.options import ResultsOptions, default_is

EXAMPLES = (
    ("a plate of 0.5 m by 2 cm", "trackslip localize run.mcap --plate 0.5x0.02"),
    ("a scanner whose place is known", "trackslip localize run.mcap --plate 0.5x0.02 --mount -1.5 -1.5 1.57"),
    ("by other poses", "trackslip localize run.mcap --plate 0.5x0.02 --poses /amcl_pose"),
)


@dataclass(frozen=True, kw_only=True)
class Config(BagOptions, ResultsOptions):
    """Find the plate on a robot in the scans of a stationary laser range finder, and write its poses as a log."""

    path: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="BAG")]
    """A .bag, .mcap or .db3 file, or a folder of bags."""
    plate: Annotated[str, tyro.conf.arg(metavar="LENGTHxTHICKNESS")] = field()
    """Size of the plate, as in 0.5x0.02 [m]."""
    poses: Annotated[str | None, default_is("none", "TOPIC")] = None
    """Topic of other poses, or tf:PARENT:CHILD, by which to find the pose of the scanner in their frame."""
    out: Path = Path("out/localize")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figure as PDF."""

    def __post_init__(self) -> None:
        ResultsOptions.__post_init__(self)
        self.choice()


def run(config: Config) -> None:
    """Locate, store and print."""
    from experiments.common.page import drawn
    from experiments.common.results import FIGURES_FOLDER, RUNS_FILE
    from experiments.common.run import Run
    from experiments.identify.localization_figures import field as field_figure
    from experiments.identify.localized import described, drives_table, place_lines, stand_line
    from trackslip.ros.scanned import read_scanned

    with Run(config) as run:
        with run.busy("localization"):
            drives, refused, notes = read_scanned(config.path, config.choice())
        warnings = (*notes, *map(str, refused))
        run.write({"drives": [described(drive) for drive in drives], "warnings": warnings}, [one.log for one in drives])
        figures = run.folder / FIGURES_FOLDER
        figures.mkdir()
        drawn("field", field_figure(drives), config.pdf).write(figures)
    print(drives[0].taken)
    drives_table(f"The plate of {config.plate} m in scans", drives).print()
    lines = [*dict.fromkeys(stand_line(drive.stand) for drive in drives)]
    if len(drives) == 1:
        lines += place_lines(drives[0].place)
    for line in (*lines, *(f"warning: {line}" for line in warnings)):
        print(line)
    print(f"{config.out / RUNS_FILE}: {run.wall:.1f} s; next: trackslip identify {shlex.quote(str(config.out))}")
