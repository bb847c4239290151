"""A law as a program: a C header that needs only <math.h>, or a Python module that needs only `math`.

Their functions are the equations of `trackslip.laws`, from the folder `templates`; the law's numbers are written in
front of them as constants.
"""

from __future__ import annotations

from pathlib import Path

from trackslip.deploy.differential_drive import constant_icrs, expressible
from trackslip.deploy.facts import comment, fact_lines
from trackslip.laws.file import StoredLaws

_TEMPLATES = Path(__file__).parent / "templates"


def c_text(stored: StoredLaws, law: str) -> str:
    """A header for C99 and C++ with the functions trackslip_sprocket_speeds and trackslip_body_twist of a law."""
    lines = [
        f"static const double trackslip_{name} = {value!r}; /* {about} */\n"
        for name, (value, about) in _constants(stored, law).items()
    ]
    guard = f"TRACKSLIP_{law.upper()}_H"
    opening = f"#ifndef {guard}\n#define {guard}\n\n#include <math.h>\n\n"
    return (
        f"/*\n{comment(fact_lines(stored, law), ' *')} */\n{opening}{''.join(lines)}\n{_template(law, 'h')}\n#endif\n"
    )


def python_text(stored: StoredLaws, law: str) -> str:
    """A module with the functions `sprocket_speeds` and `body_twist` of a law."""
    lines = [f"{name.upper()} = {value!r}  # {about}\n" for name, (value, about) in _constants(stored, law).items()]
    functions = _template(law, "py")
    imports = "import math\n\n" if "math." in functions else ""
    return f"{comment(fact_lines(stored, law), '#')}\n{imports}{''.join(lines)}\n\n{functions}"


def _template(law: str, language: str) -> str:
    name = "icr" if expressible(law) else "turn_loss"
    return (_TEMPLATES / f"{name}.{language}.in").read_text(encoding="utf-8")


def _constants(stored: StoredLaws, law: str) -> dict[str, tuple[float, str]]:
    """Values and descriptions of the constants that the functions of a law use, by name."""
    geometry = stored.geometry
    radius = {"sprocket_radius": (geometry.sprocket_radius, "r [m]")}
    if expressible(law):
        sides = list(zip(("left", "right"), constant_icrs(stored, law), strict=True))
        arms = {f"reach_{side}": (geometry.half_gauge + offset, "b + D [m]") for side, (offset, _) in sides}
        return radius | arms | {f"scale_{side}": (1 + error, "1 + epsilon [-]") for side, (_, error) in sides}
    values = stored.values(law)
    errors = [value for name, value in values.items() if name.startswith("radius_error")]
    scales = {"scale_left": (1 + errors[0], "1 + epsilon [-]"), "scale_right": (1 + errors[-1], "1 + epsilon [-]")}
    reach = {"reach": (geometry.half_gauge + values["offset"], "b + D [m]")}
    return radius | reach | scales | {"turn_loss": (values["turn_loss"], "g [-]")}
