"""`trackslip bag`: the topics of a bag, what trackslip takes of them, and the log that this makes."""

import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import tyro

from experiments.common.log_options import Bag, BagOptions
from experiments.common.options import Exclusion, Needs, Options, default_is
from trackslip.errors import InvalidValueError, counted
from trackslip.ros.choice import BagChoice

if TYPE_CHECKING:
    from trackslip.ros.bag import Bag as RosBag

EXAMPLES = (
    ("its topics, and the ones that identify would read", "trackslip bag run.mcap"),
    ("as a log with units", "trackslip bag run.mcap --export log.parquet"),
    ("with other poses", "trackslip bag old.bag --poses tf:map:base_link --export log.csv"),
)
_HEADER = ("topic", "type", "messages", "rate [Hz]", "longest gap [s]", "use (*: taken)")
_FORMATS = (".parquet", ".csv")


@dataclass(frozen=True)
class Config(Options):
    """List the topics of a ROS 1 or ROS 2 bag and the ones trackslip reads; with --export, write them as a log."""

    path: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="BAG")]
    """A .bag, .mcap or .db3 file, or a folder of bags."""
    bag: Bag = field(default_factory=BagOptions)
    """Topics to read."""
    export: Annotated[Path | None, default_is("none", "FILE")] = None
    """A .parquet or .csv file to write the log to, with units."""
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Replace the file if it exists; needs --export."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (Needs(("overwrite",), "export"),)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.export is not None and self.export.suffix.lower() not in _FORMATS:
            raise InvalidValueError("export", str(self.export), f"a file that ends in {' or '.join(_FORMATS)}")


def run(config: Config) -> None:
    """Print the topics of each bag, or write the log."""
    from trackslip.ros.bag import open_bags

    choice = config.bag.choice()
    if config.export is not None:
        _export(config.path, choice, config.export, config.overwrite)
        return
    for bag in open_bags(config.path, choice.max_expanded):
        _print_topics(bag, choice)


def _print_topics(bag: "RosBag", choice: BagChoice) -> None:
    """Print the topics and their uses."""
    from experiments.common.formats import MISSING, number
    from experiments.common.table import Table
    from trackslip.ros.readers import short_type
    from trackslip.ros.sources import overview

    uses, taken, doubts = overview(bag, choice)
    rows = [
        (name, short_type(topic.type), str(topic.count), number(topic.rate, 1), number(topic.longest_gap, 2))
        for name, topic in bag.topics.items()
    ]
    rows += [(name, "transforms", MISSING, MISSING, MISSING) for name in uses if name not in bag.topics]
    begin, end = bag.span
    used = [(*row, uses.get(row[0], "")) for row in rows]
    Table(f"{bag.path}: {(end - begin) / 1e9:.1f} s", _HEADER, used).print()
    for line in (*taken, *(f"warning: {line}" for line in (*bag.notes, *doubts))):
        print(line)


def _export(path: Path, choice: BagChoice, file: Path, overwrite: bool) -> None:
    """Write the log of a bag to a file, and print what was taken; raises OutputError for a file that exists."""
    from experiments.common.results import write_output
    from trackslip.errors import OutputError
    from trackslip.logs.logfile import write_csv, write_parquet
    from trackslip.ros.drive_log import read_bags

    if file.exists() and not overwrite:
        raise OutputError(f"{file}: exists already; --overwrite replaces it")
    read = read_bags(path, choice)
    write = write_parquet if file.suffix.lower() == ".parquet" else write_csv
    write_output(file, lambda draft: write(read.runs, draft))
    for line in (*read.taken, *(f"warning: {line}" for line in read.warnings)):
        print(line)
    print(f"{file}: {counted(len(read.runs), 'run')}, {counted(sum(len(log.time) for log in read.runs), 'row')}")
    print(f"trackslip identify {shlex.quote(str(file))} --half-gauge … --sprocket-radius …")
