"""Export of laws to other programs, as code, parameters or JSON.

The code is a C header that needs only <math.h>, or a Python module that needs only `math`.
Functions from the folder `templates` implement the equations of `trackslip.laws`; the law's numbers
precede the functions as constants.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from trackslip.deploy.differential_drive import (
    CONTROLLER,
    constant_icrs,
    diff_drive_text,
    expressible,
    instead_of_best,
    law_for,
    nearest,
)
from trackslip.deploy.facts import alarms_of, comment, fact_lines, json_text
from trackslip.errors import TrackslipError, require
from trackslip.laws.families import FAMILIES
from trackslip.laws.file import StoredLaws, read_stored, stored_laws

_TEMPLATES = Path(__file__).parent / "templates"


def c_text(stored: StoredLaws, law: str) -> str:
    """Write a header for C99 and C++ with the functions trackslip_sprocket_speeds and
    trackslip_body_twist.
    """
    lines = [
        f"static const double trackslip_{name} = {value!r}; /* {about} */\n"
        for name, (value, about) in _constants(stored, law).items()
    ]
    guard = f"TRACKSLIP_{law.upper()}_H"
    opening = f"#ifndef {guard}\n#define {guard}\n\n#include <math.h>\n\n"
    return (
        f"/*\n{comment(fact_lines(stored, law), ' *')} "
        f"*/\n{opening}{''.join(lines)}\n{_template(law, 'h')}\n#endif\n"
    )


def python_text(stored: StoredLaws, law: str) -> str:
    """Write a Python module with the functions `sprocket_speeds` and `body_twist` for a law."""
    lines = [
        f"{name.upper()} = {value!r}  # {about}\n"
        for name, (value, about) in _constants(stored, law).items()
    ]
    functions = _template(law, "py")
    imports = "import math\n\n" if "math." in functions else ""
    return f"{comment(fact_lines(stored, law), '#')}\n{imports}{''.join(lines)}\n\n{functions}"


def _template(law: str, language: str) -> str:
    name = "icr" if expressible(law) else "turn_loss"
    return (_TEMPLATES / f"{name}.{language}.in").read_text(encoding="utf-8")


def _constants(stored: StoredLaws, law: str) -> dict[str, tuple[float, str]]:
    """Values and descriptions of the constants in a law's functions, by name."""
    geometry = stored.geometry
    radius = {"sprocket_radius": (geometry.sprocket_radius, "r [m]")}
    if expressible(law):
        sides = list(zip(("left", "right"), constant_icrs(stored, law), strict=True))
        arms = {
            f"reach_{side}": (geometry.half_gauge + offset, "b + D [m]")
            for side, (offset, _) in sides
        }
        return (
            radius
            | arms
            | {f"scale_{side}": (1 + error, "1 + epsilon [-]") for side, (_, error) in sides}
        )
    values = stored.values(law)
    errors = [value for name, value in values.items() if name.startswith("radius_error")]
    scales = {
        "scale_left": (1 + errors[0], "1 + epsilon [-]"),
        "scale_right": (1 + errors[-1], "1 + epsilon [-]"),
    }
    reach = {"reach": (geometry.half_gauge + values["offset"], "b + D [m]")}
    return radius | reach | scales | {"turn_loss": (values["turn_loss"], "g [-]")}


if TYPE_CHECKING:
    from trackslip.identification.result import Identification

TARGETS: dict[str, Callable[..., str]] = {
    "ros2_control": diff_drive_text,
    "ros_control": partial(diff_drive_text, ros=1),
    "json": json_text,
    "c": c_text,
    "python": python_text,
}
"""Functions by deployment target that return the text of a file, given stored laws and the name of
a law.
"""


@dataclass(frozen=True)
class Deployed:
    """A law in the format of another program."""

    law: str
    """Name of the law."""
    text: str
    """Text of the file."""
    instead: str
    """A sentence if an expressible law replaces the best law; empty if the best law is used."""


def deploy_law(
    source: str | Path | Identification,
    to: str = "ros2_control",
    law: str | None = None,
    controller: str = CONTROLLER,
    accept: bool = False,
) -> str:
    """Write the text of a file with which another program drives and computes odometry according to
    a slip law.

    Args:
        source: a folder of results, a JSON file of laws, or an identification.
        to: `ros2_control` (parameters of diff_drive_controller as YAML), `ros_control` (YAML for
            ROS 1), `json`, `c` (a header) or `python` (a module).
        law: name of the law; by default the law that gives the multipliers, for `ros2_control` and
            `ros_control`, and the best law that the target can express for others.
        controller: name of the robot's controller, used for ros2_control and ros_control.
        accept: whether to deploy a law even if its identification raised an alarm.

    Raises TrackslipError for a source without laws, for an unknown target or law, for an invalid
    controller name, for a law that the target can't express, and for an alarm that isn't accepted.
    """
    return deployed(source, to, law, controller, accept).text


def deployed(
    source: str | Path | Identification,
    to: str,
    law: str | None = None,
    controller: str = CONTROLLER,
    accept: bool = False,
) -> Deployed:
    """Write a law for another program. The arguments are those of `deploy_law`."""
    require(to in TARGETS, "to", to, f"one of {', '.join(TARGETS)}")
    if isinstance(source, str | Path):
        stored = read_stored(Path(source))
    else:
        # imported late because it needs SciPy
        from trackslip.identification.result import identification_to_json

        stored = stored_laws(identification_to_json(source), "the identification")
    name = stored.law_named(law_for(stored, to) if law is None else law)
    if to not in FAMILIES[name].targets:
        what = (
            "can express constant ICRs and turn loss"
            if to in ("c", "python")
            else "can only express constant ICRs"
        )
        raise TrackslipError(f"law = {name!r}: {to} {what}; {nearest(stored, to)}")
    if (alarms := alarms_of(stored)) and not accept:
        raise TrackslipError(f"law {name}: ALARM {alarms[0]}: --accept deploys it all the same")
    named = {"controller": controller} if to in ("ros2_control", "ros_control") else {}
    return Deployed(name, TARGETS[to](stored, name, **named), instead_of_best(stored, name))
