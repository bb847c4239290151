"""Checks that options share; each raises InvalidValueError, naming the option, its value and what is allowed."""

import dataclasses
from collections.abc import Iterable
from typing import Any

from trackslip.errors import InvalidValueError, require_positive

MIN_SPEED = 1e-3
"""Lowest speed that can be commanded [m/s]."""


def require_between(name: str, value: float, least: float, most: float, unit: str = "") -> None:
    """Refuse a number outside `least` to `most`, and NaN."""
    if not least <= value <= most:
        raise InvalidValueError(name, value, f"from {least:g} to {most:g} {unit}".strip())


def require_speed(name: str, speed: float, top_speed: float) -> None:
    """Refuse a speed [m/s] that is not positive, below MIN_SPEED, or above what the drive allows."""
    require_positive(name, speed)
    if speed > top_speed:
        raise InvalidValueError(name, speed, f"at most drive.top_speed = {top_speed} m/s")
    if speed < MIN_SPEED:
        raise InvalidValueError(name, speed, f"at least {MIN_SPEED:g} m/s")


def refuse_unused(options: Any, names: Iterable[str], reason: str) -> None:
    """Refuse options that would have no effect, unless they have their default values."""
    for option in dataclasses.fields(options):
        value = getattr(options, option.name)
        if option.name in names and value != option.default:
            raise InvalidValueError(option.name, value, f"left out {reason}")


def refuse_changed(name: str, value: Any, default: Any, reason: str) -> None:
    """Refuse an option, or the first of a group, that would have no effect but has another value than by default."""
    if dataclasses.is_dataclass(value):
        for option in dataclasses.fields(value):
            inner = f"{name}.{option.name}".removesuffix(".source")
            refuse_changed(inner, getattr(value, option.name), getattr(default, option.name), reason)
    elif value != default:
        raise InvalidValueError(name, value, f"left out {reason}")
