"""A law as a C header without dependencies but <math.h>: C99 and C++."""

from __future__ import annotations

from trackslip.deploy.c_laws import EXPONENTIAL, ICR, TURN_LOSS, TYPES
from trackslip.deploy.constants import constants_of
from trackslip.deploy.facts import commented, fact_lines
from trackslip.slip.stored_laws import StoredLaws

_FUNCTIONS = {"exponential": EXPONENTIAL, "turn_loss": TURN_LOSS}  # of laws without constant ICRs


def c_text(stored: StoredLaws, law: str) -> str:
    """A header with the functions trackslip_sprocket_speeds and trackslip_body_twist of a law."""
    guard = f"TRACKSLIP_{law.upper()}_H"
    constants = "".join(
        f"static const double trackslip_{name} = {value!r}; /* {about} */\n"
        for name, (value, about) in constants_of(stored, law).items()
    )
    if law == "exponential":
        constants += f"enum {{ trackslip_iterations = {stored.laws[law].twist_iterations} }};\n"
    comment = f"/*\n{commented(fact_lines(stored, law), ' *')} */\n"
    opening = f"#ifndef {guard}\n#define {guard}\n\n#include <math.h>\n\n"
    return f"{comment}{opening}{constants}\n{TYPES}\n{_FUNCTIONS.get(law, ICR)}\n#endif\n"
