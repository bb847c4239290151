"""What is allowed of a course: limits, and the checks that name the field, its value and what is allowed."""

from __future__ import annotations

import math
from numbers import Integral

from trackslip.errors import require

MAX_LENGTH = 200.0
"""Largest length and width of anything on a course [m]."""
MIN_LENGTH = 0.001
"""Smallest length and width [m]."""
MAX_HEIGHT = 10.0
"""Largest height of anything on a course [m]."""
MIN_HEIGHT = 1e-4
"""Smallest height of a step, a beam or a rough stretch [m]."""
MAX_ANGLE = 1.2
"""Largest angle of a ramp or a side slope [rad]."""
MAX_NUMBER = 500
"""Largest number of stairs, beams or pallets in a piece."""
MAX_COURSE = 1000.0
"""Largest length of a course [m]."""
MAX_SAMPLES = 1_000_000
"""Largest number of samples of a height field."""
MAX_SIDE = 2000
"""Largest number of samples along a side of rough ground, whose spectrum takes four times its square."""
MAX_LOOKED_AT = 100_000_000
"""Largest number of samples near triangles of a mesh, each triangle's counted."""


def require_between(field: str, value: float, low: float, high: float, unit: str = "") -> None:
    """Raise InvalidValueError unless `low` <= `value` <= `high`."""
    require(low <= value <= high, field, value, f"from {low:g} to {high:g} {unit}".strip())


def require_length(field: str, value: float) -> None:
    """Raise InvalidValueError unless `value` is a length or a width that a course may have [m]."""
    require_between(field, value, MIN_LENGTH, MAX_LENGTH, "m")


def require_change(field: str, value: float) -> None:
    """Raise InvalidValueError unless `value` is a height to go up (> 0) or down (< 0) [m]."""
    allowed = f"from {MIN_HEIGHT:g} to {MAX_HEIGHT:g} m, or its negative to go down"
    require(MIN_HEIGHT <= abs(value) <= MAX_HEIGHT, field, value, allowed)


def require_height(field: str, value: float) -> None:
    """Raise InvalidValueError unless `value` is the height of something that stands on the ground [m]."""
    require_between(field, value, MIN_HEIGHT, MAX_HEIGHT, "m")


def require_angle(field: str, value: float) -> None:
    """Raise InvalidValueError unless `value` is the angle of a slope, in either direction [rad]."""
    require_between(field, value, -MAX_ANGLE, MAX_ANGLE, f"rad ({math.degrees(MAX_ANGLE):.0f} degrees)")


def require_number(field: str, value: int) -> None:
    """Raise InvalidValueError unless `value` is how many of something a piece may have."""
    require(is_whole(value) and 1 <= value <= MAX_NUMBER, field, value, f"a whole number from 1 to {MAX_NUMBER}")


def is_whole(value: object) -> bool:
    """Whether `value` is a whole number, Python's or NumPy's."""
    return isinstance(value, Integral) and not isinstance(value, bool)
