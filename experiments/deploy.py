"""`trackslip deploy`: write an identified law for ROS 2, C or Python."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Final, Literal

import tyro

from experiments.common.options import Exclusion, Needs, Options, default_is
from experiments.common.results import write_outputs
from trackslip.deploy.deploy import deployed
from trackslip.laws.file import SHIPPED

EXAMPLES: Final = (
    ("parameters of diff_drive_controller", "trackslip deploy out/identify"),
    (
        "a C header with another law",
        "trackslip deploy out/identify --to c --law turn_loss --out slip.h",
    ),
    ("the shipped robot's law in Python", "trackslip deploy --to python --out slip.py"),
)


@dataclass(frozen=True)
class Config(Options):
    """Print or write an identified law for another program: parameters of ros2_control, JSON, a C
    header or Python.
    """

    path: Annotated[
        Path | None, tyro.conf.Positional, default_is("the laws shipped with trackslip", "LAWS")
    ] = None
    """Results folder with laws, or a JSON file of laws."""
    to: Literal["ros2_control", "ros_control", "json", "c", "python"] = "ros2_control"
    """Parameters of diff_drive_controller (YAML for ROS 2 or 1), JSON, a C header, or a Python
    module.
    """
    law: Annotated[str | None, default_is("the best that the target can express", "NAME")] = None
    """Name of the law; diff_drive_controller accepts none, icr, icr_radius, diff_drive and
    icr_sides."""
    controller: str = "diff_drive_controller"
    """Name of the robot's controller, such as platform_velocity_controller."""
    accept: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Deploy the law even if its identification raised an alarm."""
    out: Annotated[Path | None, default_is("print it", "FILE")] = None
    """File to write."""
    overwrite: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Replace the file if it exists; needs --out."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Needs(("overwrite",), "out"),
        Needs(("controller",), "to", ("ros2_control", "ros_control")),
    )


def run(config: Config) -> None:
    """Print the deployed law, or write it to a file."""
    program = deployed(
        config.path or SHIPPED, config.to, config.law, config.controller, config.accept
    )
    if config.out is None:
        print(program.text, end="")
        return
    write_outputs(
        {config.out: lambda draft: draft.write_text(program.text, encoding="utf-8")},
        config.overwrite,
    )
    print(f"{config.out}: written for {config.to}, law {program.law}")
    if program.instead:
        print(f"warning: {program.instead}")
