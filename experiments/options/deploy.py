"""Options of `trackslip deploy`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from experiments.options.help import default_is
from trackslip.errors import InvalidValueError


@dataclass(frozen=True)
class DeployConfig:
    """Print or write an identified law for another program: parameters of ros2_control, JSON, a C header or Python."""

    path: Annotated[Path | None, tyro.conf.Positional, default_is("the laws shipped with trackslip", "LAWS")] = None
    """Folder of results with laws, or a JSON file of laws."""
    to: Literal["ros2_control", "json", "c", "python"] = "ros2_control"
    """Parameters of diff_drive_controller as YAML, JSON, a header with functions, or the same in Python."""
    law: Annotated[str | None, default_is("the best that the target can express", "NAME")] = None
    """The law; ros2_control takes none, icr, icr_radius and icr_sides."""
    out: Annotated[Path | None, default_is("print it", "FILE")] = None
    """File to write."""
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Replace the file if it exists; needs --out."""

    def __post_init__(self) -> None:
        if self.overwrite and self.out is None:
            raise InvalidValueError("overwrite", self.overwrite, "left out without --out")
