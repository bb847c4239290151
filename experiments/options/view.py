"""Options of `trackslip view`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from experiments.options.help import default_is
from trackslip.errors import InvalidValueError


@dataclass(frozen=True)
class ViewConfig:
    """Show stored runs in the rerun viewer: one, or several side by side on the same time line."""

    path: tyro.conf.Positional[Path]
    """Folder of results, or a .parquet or .csv log, also of a real robot."""
    run: Annotated[
        tuple[str, ...],
        tyro.conf.UseAppendAction,
        tyro.conf.arg(metavar="ID", help_behavior_hint="(default: the first; may be repeated)"),
    ] = ()
    """Name of a run or, in a grid's folder, its id or the beginning of its id; repeat the option to compare runs."""
    web: bool = False
    """Show them in the browser, until interrupted."""
    save: Annotated[Path | None, default_is("none", "FILE")] = None
    """Write an .rrd file instead, for `rerun FILE`."""

    def __post_init__(self) -> None:
        if self.save is not None and self.save.suffix.lower() != ".rrd":
            raise InvalidValueError("save", str(self.save), "a file that ends in .rrd")
        if self.save is not None and self.web:
            raise InvalidValueError("web", self.web, "left out with --save")
        if len(set(self.run)) < len(self.run):
            raise InvalidValueError("run", self.run, "all different")
