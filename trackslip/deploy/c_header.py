"""A law as a C header without dependencies but <math.h>: C99 and C++."""

from __future__ import annotations

from trackslip.deploy.c_laws import ICR, TURN_LOSS, TYPES
from trackslip.deploy.c_slips import CONSTANT_TWIST, SLIP, SLIPS, SPROCKET_SPEEDS, TWIST
from trackslip.deploy.constants import constants_of
from trackslip.deploy.facts import commented, fact_lines
from trackslip.slip.stored_laws import StoredLaws


def c_text(stored: StoredLaws, law: str) -> str:
    """A header with the functions trackslip_sprocket_speeds and trackslip_body_twist of a law."""
    guard = f"TRACKSLIP_{law.upper()}_H"
    constants = "".join(
        f"static const double trackslip_{name} = {value!r}; /* {about} */\n"
        for name, (value, about) in constants_of(stored, law).items()
    )
    comment = f"/*\n{commented(fact_lines(stored, law), ' *')} */\n"
    opening = f"#ifndef {guard}\n#define {guard}\n\n#include <math.h>\n\n"
    return f"{comment}{opening}{constants}\n{TYPES}\n{_functions(stored, law)}\n#endif\n"


def _functions(stored: StoredLaws, law: str) -> str:
    if law == "constant":
        return SLIP + SLIPS[law] + SPROCKET_SPEEDS + CONSTANT_TWIST
    if law in SLIPS:
        iterations = f"enum {{ trackslip_iterations = {stored.laws[law].twist_iterations} }};\n\n"
        return iterations + SLIP + SLIPS[law] + SPROCKET_SPEEDS + TWIST
    return TURN_LOSS if law == "turn_loss" else ICR
