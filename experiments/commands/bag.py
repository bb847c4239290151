"""`trackslip bag`: the topics of a bag, what trackslip takes of them, and the log that this makes."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from experiments.options.bag_choice import Bag, BagOptions
from experiments.options.base import Exclusion, Needs, Options
from experiments.options.help import default_is
from trackslip.errors import InvalidValueError

EXAMPLES = (
    ("topics, and what is taken for what", "trackslip bag run.mcap"),
    ("as a log with units", "trackslip bag run.mcap --export log.parquet"),
    ("with other poses", "trackslip bag old.bag --poses tf:map:base_link --export log.csv"),
)
_FORMATS = (".parquet", ".csv")


@dataclass(frozen=True)
class Config(Options):
    """List the topics of a ROS 1 or ROS 2 bag, and what of them trackslip takes; with --export, write it as a log."""

    path: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="BAG")]
    """A .bag, .mcap or .db3 file, or a folder of bags."""
    bag: Bag = field(default_factory=BagOptions)
    """What to take from it."""
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
    from experiments.bags import export, print_topics
    from trackslip.ros.bag import open_bags

    choice = config.bag.choice()
    if config.export is not None:
        export(config.path, choice, config.export, config.overwrite)
        return
    for bag in open_bags(config.path):
        print_topics(bag, choice)
