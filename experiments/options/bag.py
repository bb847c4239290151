"""Options of `trackslip bag`."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from experiments.options.bag_choice import Bag, BagOptions
from experiments.options.checks import refuse_unused
from experiments.options.help import default_is
from trackslip.errors import InvalidValueError

_FORMATS = (".parquet", ".csv")


@dataclass(frozen=True)
class BagConfig:
    """List the topics of a ROS 1 or ROS 2 bag, and what of them trackslip takes; with --export, write it as a log."""

    path: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="BAG")]
    """A .bag, .mcap or .db3 file, or a folder of bags."""
    bag: Bag = field(default_factory=BagOptions)
    """What to take from it."""
    export: Annotated[Path | None, default_is("none", "FILE")] = None
    """A .parquet or .csv file to write the log to, with units."""
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Replace the file if it exists; needs --export."""

    def __post_init__(self) -> None:
        if self.export is None:
            refuse_unused(self, ("overwrite",), "without --export")
        elif self.export.suffix.lower() not in _FORMATS:
            raise InvalidValueError("export", str(self.export), f"a file that ends in {' or '.join(_FORMATS)}")
