"""The function that shows a result, by the result's class."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any


def by_class(functions: Mapping[type, Callable[..., Any]], result: object) -> Callable[..., Any]:
    """The function for the class of a `result` or, for a subclass, for the next class above it."""
    for kind in type(result).__mro__:
        if kind in functions:
            return functions[kind]
    raise NotImplementedError(f"{type(result).__name__} has no view")
