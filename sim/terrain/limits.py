"""What is allowed of a course: limits, and the checks that name the field, its value and what is allowed."""

from __future__ import annotations

import math

from trackslip.errors import require, require_whole

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
    require_whole(field, value, 1, MAX_NUMBER)
