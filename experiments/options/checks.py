"""Checks that options share; each raises InvalidValueError, naming the option, its value and what is allowed."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Any

from trackslip.errors import InvalidValueError


def require_integer(name: str, value: int, least: int = 0, most: int | None = None) -> None:
    """Refuse an integer outside `least` to `most`."""
    if value < least or (most is not None and value > most):
        allowed = f"an integer >= {least}" if most is None else f"an integer from {least} to {most}"
        raise InvalidValueError(name, value, allowed)


def require_between(name: str, value: float, least: float, most: float, unit: str = "") -> None:
    """Refuse a number outside `least` to `most`, and NaN."""
    if not least <= value <= most:
        raise InvalidValueError(name, value, f"from {least:g} to {most:g} {unit}".strip())


def require_distinct(name: str, values: Sequence[Any] | None, what: str = "value") -> None:
    """Refuse an empty list and repeated values; None is an option that isn't given."""
    if values is None:
        return
    if not values:
        raise InvalidValueError(name, values, f"at least one {what}")
    if len(set(values)) < len(values):
        raise InvalidValueError(name, values, "all different")


def refuse_unused(options: Any, names: Iterable[str], reason: str) -> None:
    """Refuse options that would have no effect, unless they have their default values."""
    for option in dataclasses.fields(options):
        value = getattr(options, option.name)
        if option.name in names and value != option.default:
            raise InvalidValueError(option.name, value, f"left out {reason}")
