"""Keyword arguments of `gymnasium.make`, as the configuration of a task."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

from trackslip.errors import require

C = TypeVar("C")


def from_options(configuration: type[C], options: Mapping[str, Any]) -> C:
    """Build the dataclass `configuration` from keyword arguments; lists become tuples.

    Raises InvalidValueError for unknown names, and what the configuration itself refuses.
    """
    known = [f.name for f in fields(configuration)]  # type: ignore[arg-type]
    for name in options:
        require(name in known, "option", name, f"one of {', '.join(known)}")
    return configuration(**{n: tuple(value) if isinstance(value, list) else value for n, value in options.items()})
