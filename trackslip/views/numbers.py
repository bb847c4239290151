"""Numbers and intervals as text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

MISSING: Final = "–"
"""What stands in place of an unknown value."""
_MAX_DIGITS: Final = 4  # largest number of decimals


def number(value: float | None, digits: int, unit: str = "") -> str:
    """Format a number with `digits` decimals and its unit; MISSING for None, NaN and infinite
    values.
    """
    if value is None or not math.isfinite(value):
        return MISSING
    rounded = round(value, digits) + 0.0  # without the sign of a zero
    return f"{rounded:.{digits}f} {unit}".rstrip().replace("-", "−")


def with_interval(
    value: float,
    ends: Sequence[float] | None,
    unit: tuple[float, str] = (1.0, ""),
    *,
    why_none: str,
) -> str:
    """Format a value with its 95 % interval, rounded to two significant digits of the half-width.

    `unit` is the factor from SI and the name of the printed unit. If `ends` is None or NaN,
    `why_none` stands in place of the interval.
    """
    factor, name = unit
    low, high = (math.nan, math.nan) if ends is None else (factor * end for end in ends)
    half_width = (high - low) / 2
    if not math.isfinite(half_width):
        text = f"{factor * value:.4g} {name}".rstrip().replace("-", "−")
        return f"{text} ({why_none})"
    digits = _MAX_DIGITS
    if half_width > 0:
        two_significant = 1 - math.floor(math.log10(half_width))
        digits = min(_MAX_DIGITS, max(0, two_significant))
    text = number(factor * value, digits, name)
    return f"{text} ({number(low, digits)} to {number(high, digits)})"
