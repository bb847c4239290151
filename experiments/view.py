"""`trackslip view`: show runs in the rerun viewer, in a browser or in a file."""

import shlex
import tempfile
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from shutil import copyfile
from typing import Annotated, ClassVar, Final

import tyro

from experiments.common.choices import ROBOTS
from experiments.common.leftovers import temporary
from experiments.common.log_options import LayoutOptions, MaxMemory, TableLayout, size_in_bytes
from experiments.common.options import Distinct, Excludes, Exclusion, Options, default_is
from experiments.common.plain_json import plain
from experiments.common.results import DRIVE_RECORDING, RECORDINGS_FOLDER, file_names, write_output
from experiments.recorder import record, title, viewer
from sim.robot.named import load_parameters
from trackslip.bags.choice import AUTOMATIC, BagChoice
from trackslip.bags.drives import holds_bags, runs_of
from trackslip.errors import InvalidValueError

EXAMPLES: Final = (
    ("the first run", "trackslip view out/track"),
    ("compare two runs", 'trackslip view out/reproduce --run "linear none" --run "linear icr"'),
    ("a file for the viewer", "trackslip view log.csv --save log.rrd"),
    ("your log with your robot", "trackslip view log.csv --robot my_robot.toml"),
)


@dataclass(frozen=True)
class Config(Options):
    """Show stored runs in the rerun viewer: a single run, or several runs on the same timeline."""

    path: tyro.conf.Positional[Path]
    """Results folder, or a .parquet or .csv log, also from a real robot."""
    run: Annotated[
        tuple[str, ...],
        tyro.conf.UseAppendAction,
        tyro.conf.arg(metavar="NAME", help_behavior_hint="(default: the first; may be repeated)"),
    ] = ()
    """Name of a run; repeat the option to compare runs."""
    web: bool = False
    """Show the runs in the browser, until interrupted."""
    robot: Annotated[str | None, default_is("the log's", ROBOTS)] = None
    """Robot to show in place of the log's: a name, or a file as for other commands."""
    save: Annotated[Path | None, default_is("none", "FILE")] = None
    """Write an .rrd file instead, for `rerun FILE`."""
    table: TableLayout = field(default_factory=LayoutOptions)
    """Names and units of a table's columns."""
    max_memory: MaxMemory = None
    """Most memory for what the log unpacks to, such as 8GB; a log that needs more is refused."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (Excludes(("web",), "save"),)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.save is not None and self.save.suffix.lower() != ".rrd":
            raise InvalidValueError("save", str(self.save), "a file that ends in .rrd")
        if self.run:
            Distinct().check("run", self.run)


def run(config: Config) -> None:
    """Read runs, choose some of them, and show or save them."""
    recording = config.path / RECORDINGS_FOLDER / DRIVE_RECORDING
    if recording.is_file():  # the recording shows the course, which is not in the log
        given = {
            "run": config.run,
            "robot": config.robot,
            "max_memory": config.max_memory,
            **vars(config.table),
        }
        for option, value in given.items():
            if value:
                raise InvalidValueError(
                    option, value, f"left out: {config.path} has one run, with its recording"
                )
        if config.save is None:
            viewer.show(recording, config.web)
        else:
            write_output(config.save, partial(copyfile, recording))
            print(f"{config.save}: {recording}; to open it: rerun {shlex.quote(str(config.save))}")
        return
    runs = runs_of(
        config.path,
        BagChoice(dead_reckoned=True) if holds_bags(config.path) else AUTOMATIC,
        size_in_bytes("max_memory", config.max_memory),
        config.table.layout(),
    )
    chosen, count = viewer.choose(runs, config.run, config.path)
    for line in runs.warnings:
        print(f"warning: {line}")
    if not config.run and count > 1:
        print(
            f"{count} runs; showing {chosen[0].run!r}. --run NAME chooses one; repeat it to compare"
        )
    if config.robot is not None:
        parameters, _ = load_parameters(config.robot)
        robot = {"robot": plain(parameters)}
        chosen = [replace(log, metadata={**log.metadata, **robot}) for log in chosen]
    if config.save is not None:
        record(config.save, chosen)
        print(f"{config.save}: {title(chosen)}; to open it: rerun {shlex.quote(str(config.save))}")
        return
    with temporary(Path(tempfile.mkdtemp(prefix="trackslip-view-"))) as folder:
        file = folder / file_names([title(chosen)], ".rrd")[0]
        record(file, chosen)
        viewer.show(file, config.web)
