"""Laws for other programs in one call."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from trackslip.deploy.differential_drive import (
    CONTROLLER,
    best_expressible,
    diff_drive_text,
    instead_of_best,
    nearest,
)
from trackslip.deploy.facts import json_text
from trackslip.deploy.programs import c_text, python_text
from trackslip.errors import InvalidValueError, TrackslipError
from trackslip.slip.families import FAMILIES
from trackslip.slip.law_file import SHIPPED, read_stored, stored_laws

if TYPE_CHECKING:
    from trackslip.identification.result import Identification

TARGETS: dict[str, Callable[..., str]] = {
    "ros2_control": diff_drive_text,
    "ros_control": partial(diff_drive_text, ros=1),
    "json": json_text,
    "c": c_text,
    "python": python_text,
}
"""Targets of a deployment: the text of a file, from laws and the name of one of them."""


@dataclass(frozen=True)
class Deployed:
    """A law as another program takes it."""

    law: str
    """Name of the law."""
    text: str
    """Text of the file."""
    instead: str
    """Accuracy lost by using an expressible law instead of the best; empty if the best law is used."""


def deploy_law(
    source: str | Path | Identification = SHIPPED,
    to: str = "ros2_control",
    law: str | None = None,
    controller: str = CONTROLLER,
) -> str:
    """The text of a file by which another program drives, and computes odometry, under a slip law.

    Its comments state the law, its intervals, its origin, and the accuracy that odometry gains.

    Args:
        source: a folder of results, a JSON file of laws, or an identification; by default the shipped laws.
        to: `ros2_control`: parameters of diff_drive_controller as YAML; `ros_control`: the same for ROS 1; `json`;
            `c`: a header with functions from twist to sprocket speeds and back; `python`: the same as a module that
            needs nothing but `math`.
        law: name of the law; by default the best one that the target can express.
        controller: name of the robot's controller, for ros2_control and ros_control.

    Raises:
        LogError: if the source holds no laws.
        InvalidValueError: for an unknown target or law, or a controller that is no name.
        TrackslipError: if the target can't express the law; the message names the nearest one that it can.
    """
    return deployed(source, to, law, controller).text


def deployed(
    source: str | Path | Identification, to: str, law: str | None = None, controller: str = CONTROLLER
) -> Deployed:
    """A law for another program, chosen as by `deploy_law`."""
    if to not in TARGETS:
        raise InvalidValueError("to", to, f"one of {', '.join(TARGETS)}")
    if isinstance(source, str | Path):
        stored = read_stored(Path(source))
    else:
        from trackslip.identification.result import identification_to_json  # late: it takes SciPy

        stored = stored_laws(identification_to_json(source), "the identification")
    ros = to in ("ros2_control", "ros_control")
    name = stored.law_named(best_expressible(stored) if law is None and ros else law)
    if not ros and to not in FAMILIES[name].targets:
        can = "can express constant ICRs, turn loss and the exponential"
        why = "has no input for the load" if FAMILIES[name].loaded else can
        raise TrackslipError(f"law = {name!r}: {to} {why}; {nearest(stored, name)}")
    if ros:
        return Deployed(name, TARGETS[to](stored, name, controller), instead_of_best(stored, name))
    return Deployed(name, TARGETS[to](stored, name), "")
