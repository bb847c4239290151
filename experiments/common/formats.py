"""Printed numbers: a true minus sign, and a dash where there is no number."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from trackslip.kinematics import Array

MISSING = "–"


def number(value: float | None, digits: int, unit: str = "") -> str:
    """A number with that many decimals and its unit; MISSING for None and for what is not finite."""
    if value is None or not math.isfinite(value):
        return MISSING
    return f"{value:.{digits}f} {unit}".rstrip().replace("-", "−")


def significant(value: float | None, unit: str = "", digits: int = 2) -> str:
    """A number with that many significant digits, never in exponential notation, and its unit."""
    if value is None or not math.isfinite(value):
        return MISSING
    places = 0 if value == 0 else max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:,.{places}f} {unit}".rstrip().replace("-", "−")


def percent(share: float | None) -> str:
    """A share in per cent, with two significant digits."""
    return significant(None if share is None else 100 * share, "%")


def pair(values: Sequence[str], unit: str = "") -> str:
    """Printed values side by side, with their unit."""
    return f"{' | '.join(values)} {unit if set(values) != {MISSING} else ''}".rstrip()


def span(values: Array, unit: str = "") -> str:
    """Smallest and largest of some values, or the one value that they all have, with three significant digits."""
    low, high = float(np.min(values)), float(np.max(values))
    text = f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}"
    return f"{text}{unit}" if unit == "°" else f"{text} {unit}".rstrip()


def stages_text(stages: Mapping[str, float]) -> str:
    """Seconds per stage, on one line."""
    return ", ".join(f"{name} {seconds:.1f} s" for name, seconds in stages.items())
