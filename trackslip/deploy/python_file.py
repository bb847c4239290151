"""A law as a Python file that needs nothing but `math`."""

from __future__ import annotations

from trackslip.deploy.constants import constants_of, is_linear
from trackslip.deploy.facts import commented, fact_lines
from trackslip.deploy.python_laws import EXPONENTIAL, ICR, TURN_LOSS
from trackslip.slip.stored_laws import StoredLaws

_FUNCTIONS = {"exponential": EXPONENTIAL, "turn_loss": TURN_LOSS}  # of laws without constant ICRs


def python_text(stored: StoredLaws, law: str) -> str:
    """A module with the functions `sprocket_speeds` and `body_twist` of a law."""
    constants = "".join(
        f"{name.upper()} = {value!r}  # {about}\n" for name, (value, about) in constants_of(stored, law).items()
    )
    if law == "exponential":
        constants += f"ITERATIONS = {stored.laws[law].twist_iterations}\n"
    needed = "" if is_linear(law) else "import math\n\n"
    return f"{commented(fact_lines(stored, law), '#')}\n{needed}{constants}\n\n{_FUNCTIONS.get(law, ICR)}"
