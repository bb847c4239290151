"""A law as a Python file that needs nothing but `math`."""

from __future__ import annotations

from trackslip.deploy.constants import LINEAR, constants_of
from trackslip.deploy.facts import commented, fact_lines
from trackslip.deploy.python_laws import (
    CONSTANT_TWIST,
    CURVATURE,
    DIVIDED,
    ICR,
    SLIPS,
    SPROCKET_SPEEDS,
    TURN_LOSS,
    TWIST,
)
from trackslip.slip.stored_laws import StoredLaws


def python_text(stored: StoredLaws, law: str) -> str:
    """A module with the functions `sprocket_speeds` and `body_twist` of a law."""
    constants = "".join(
        f"{name.upper()} = {value!r}  # {about}\n" for name, (value, about) in constants_of(stored, law).items()
    )
    if law in SLIPS and law != "constant":
        constants += f"ITERATIONS = {stored.laws[law].twist_iterations}\n"
    needed = "" if law in LINEAR else "import math\n\n"
    return f"{commented(fact_lines(stored, law), '#')}\n{needed}{constants}\n\n{_functions(law)}"


def _functions(law: str) -> str:
    if law in SLIPS:
        return SPROCKET_SPEEDS + (CONSTANT_TWIST if law == "constant" else TWIST) + SLIPS[law] + CURVATURE + DIVIDED
    return TURN_LOSS if law == "turn_loss" else ICR
