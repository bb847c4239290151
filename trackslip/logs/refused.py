"""Runs that cannot be used, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Refused:
    """A run that cannot be read, gave no sample or was excluded from the fits."""

    run: str
    """Name of the run, or of its steady stretch."""
    reason: str
    """Why it was excluded."""

    @classmethod
    def of(cls, run: str, error: Exception) -> Refused:
        """A run that raised an error, whose message may begin with the name of the run."""
        return cls(run, str(error).removeprefix(f"run {run!r}: "))

    def __str__(self) -> str:
        return f"run {self.run!r} left out: {self.reason}"


def none_usable(refused: Sequence[Refused]) -> str:
    """One line for a log all of whose runs are refused."""
    every = f"none of the {len(refused)} runs can be used; " if len(refused) > 1 else ""
    return f"{every}run {refused[0].run!r}: {refused[0].reason}"
