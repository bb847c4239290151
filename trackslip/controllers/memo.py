"""Caching what a controller derives from a reference."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

from trackslip.trajectory.base import Reference

T = TypeVar("T")


class OncePerReference(Generic[T]):
    """Caches the value built for the last reference, compared by identity."""

    def __init__(self, build: Callable[[Reference], T]) -> None:
        self._build = build
        self._kept: tuple[Reference, T] | None = None

    def __call__(self, reference: Reference) -> T:
        """The value for `reference`, built unless it is the reference of the last call."""
        if self._kept is None or self._kept[0] is not reference:
            self._kept = (reference, self._build(reference))
        return self._kept[1]
