"""Robot files: a robot's parameters and its ground in TOML, written by `trackslip calibrate`."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from sim.ground.ground import Ground
from sim.robot.parameters import RobotParameters
from sim.toml_file import build, read_toml


def load_robot_file(path: Path | None) -> tuple[RobotParameters, Ground]:
    """Load the fields of RobotParameters and, from the table `ground`, those of Ground; missing ones are the defaults.

    None is the shipped robot on its ground. Raises SettingsFileError for an unreadable file and invalid fields.
    """
    if path is None:
        return RobotParameters(), Ground()
    table = read_toml(path)
    ground = build(Ground, table.pop("ground", {}), f"{path}: ground", Ground())
    return build(RobotParameters, table, str(path)), ground


def robot_file_text(parameters: RobotParameters, ground: Ground, comment: str) -> str:
    """Text of a robot file; `ground` must be level, without patches and changes."""
    shear = f"shear = {ground.shear!r}\n" if ground.shear > 0 else ""
    lines = [f"{name} = {value!r}\n" for name, value in dataclasses.asdict(parameters).items()]
    return f"# {comment}\n{''.join(lines)}\n[ground]\nalong = {ground.along!r}\nacross = {ground.across!r}\n{shear}"
