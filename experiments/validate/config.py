"""The options of `trackslip validate`."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from experiments.common.choices import SHIPPED
from experiments.simulate.options import GroundOptions, Repeatable, RobotSource

EXAMPLES: Final = (
    ("the shipped robot", "trackslip validate"),
    (
        "a calibrated robot",
        "trackslip validate --robot out/calibrate/robot.toml --out out/validate-own",
    ),
    (
        "on ground that shears",
        "trackslip validate --robot husky --ground firm_sand --out out/validate-sand",
    ),
    ("on soft soil", "trackslip validate --ground dry_sand --out out/validate-soil"),
)


@dataclass(frozen=True)
class Config(Repeatable):
    """Compare a robot on its ground with theory: turns, loads, creep and sliding on slopes, energy;
    on soft soil, sinkage, resistance, pulls, slip uphill, turns and creep.

    Exits with 1 if a check fails. Checks that do not apply to the robot or its ground are listed
    with the reason.
    """

    robot: RobotSource = SHIPPED
    """Robot: a name, a parameter file as written by calibrate, or a model file (MJCF, URDF) with
    its tracks.
    """
    ground: GroundOptions = field(default_factory=GroundOptions)
    """Level, even ground, and properties that differ from the named ground."""
    out: Path = Path("out/validate")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figures as PDF."""
