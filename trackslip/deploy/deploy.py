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
from typing import Final

from trackslip.arguments import checks_arguments
from trackslip.deploy.differential_drive import (
    CONTROLLER,
    constant_icrs,
    diff_drive_text,
    has_constant_icrs,
    instead_of_best,
    law_for,
    nearest,
)
from trackslip.deploy.facts import alarms_of, comment, fact_lines, json_text
from trackslip.errors import TrackslipError, require_one_of
from trackslip.identification.result import Identification
from trackslip.laws.families import FAMILIES
from trackslip.laws.file import StoredLaws, read_stored, stored_laws

_TEMPLATES: Final = Path(__file__).parent / "templates"
_CODE_TARGETS: Final = ("c", "python")
_CONTROLLER_TARGETS: Final = ("ros2_control", "ros_control")


@dataclass(frozen=True)
class Constant:
    """A number in a law's functions."""

    name: str
    value: float
    meaning: str


def c_text(stored: StoredLaws, law: str) -> str:
    """Write a header for C99 and C++: trackslip_sprocket_speeds and trackslip_body_twist."""
    constants = "".join(
        f"static const double trackslip_{constant.name} = {constant.value!r}; "
        f"/* {constant.meaning} */\n"
        for constant in _constants(stored, law)
    )
    facts = comment(fact_lines(stored, law), " *")
    guard = f"TRACKSLIP_{law.upper()}_H"
    opening = f"#ifndef {guard}\n#define {guard}\n\n#include <math.h>\n\n"
    functions = _template(law, "h")
    return f"/*\n{facts} */\n{opening}{constants}\n{functions}\n#endif\n"


def python_text(stored: StoredLaws, law: str) -> str:
    """Write a Python module with the functions `sprocket_speeds` and `body_twist` for a law."""
    constants = "".join(
        f"{constant.name.upper()} = {constant.value!r}  # {constant.meaning}\n"
        for constant in _constants(stored, law)
    )
    facts = comment(fact_lines(stored, law), "#")
    functions = _template(law, "py")
    imports = "import math\n\n" if "math." in functions else ""
    return f"{facts}\n{imports}{constants}\n\n{functions}"


def _template(law: str, language: str) -> str:
    """Text of a law's functions in a language, `h` or `py`."""
    name = "icr" if has_constant_icrs(law) else "turn_loss"
    return (_TEMPLATES / f"{name}.{language}.in").read_text(encoding="utf-8")


def _constants(stored: StoredLaws, law: str) -> list[Constant]:
    """The numbers in a law's functions, in the order in which they are written."""
    half_gauge = stored.geometry.half_gauge
    icrs = constant_icrs(stored, law)
    radius = Constant("sprocket_radius", stored.geometry.sprocket_radius, "r [m]")
    scales = [
        Constant("scale_left", 1 + icrs.left_error, "1 + epsilon [-]"),
        Constant("scale_right", 1 + icrs.right_error, "1 + epsilon [-]"),
    ]
    if has_constant_icrs(law):
        reaches = [
            Constant("reach_left", half_gauge + icrs.left_offset, "b + D [m]"),
            Constant("reach_right", half_gauge + icrs.right_offset, "b + D [m]"),
        ]
        return [radius, *reaches, *scales]
    reach = Constant("reach", half_gauge + icrs.left_offset, "b + D [m]")
    turn_loss = Constant("turn_loss", stored.values(law)["turn_loss"], "g [-]")
    return [radius, reach, *scales, turn_loss]


TARGETS: Final[dict[str, Callable[..., str]]] = {
    "ros2_control": diff_drive_text,
    "ros_control": partial(diff_drive_text, ros=1),
    "json": json_text,
    "c": c_text,
    "python": python_text,
}
"""Functions by target that return the text of a file, of stored laws and the name of a law."""


@dataclass(frozen=True)
class Deployed:
    """A law in the format of another program."""

    law: str
    """Name of the law."""
    text: str
    """Text of the file."""
    instead: str
    """A sentence if an expressible law replaces the best law; empty if the best law is used."""


@checks_arguments
def deploy_law(
    source: str | Path | Identification,
    to: str = "ros2_control",
    law: str | None = None,
    controller: str = CONTROLLER,
    accept: bool = False,
) -> str:
    """Write the text of a file with which another program drives by a slip law.

    Its odometry follows the same law.

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
    require_one_of("to", to, TARGETS)

    if isinstance(source, str | Path):
        stored = read_stored(Path(source))
    else:
        # imported late because it needs SciPy
        from trackslip.identification.result import identification_to_json

        stored = stored_laws(identification_to_json(source), "the identification")

    name = stored.law_named(law_for(stored, to) if law is None else law)
    if to not in FAMILIES[name].targets:
        ability = "can only express constant ICRs"
        if to in _CODE_TARGETS:
            ability = "can express constant ICRs and turn loss"
        raise TrackslipError(f"law = {name!r}: {to} {ability}; {nearest(stored, to)}")
    alarms = alarms_of(stored)
    if alarms and not accept:
        raise TrackslipError(f"law {name}: ALARM {alarms[0]}: --accept deploys it all the same")

    options = {"controller": controller} if to in _CONTROLLER_TARGETS else {}
    text = TARGETS[to](stored, name, **options)
    return Deployed(name, text, instead_of_best(stored, name))
