"""A run that cannot be used, and why."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Refused:
    """A run that cannot be read, gave no sample or was excluded from the fits."""

    run: str
    """Name of the run."""
    reason: str
    """Why it was excluded."""

    def __str__(self) -> str:
        return f"run {self.run!r} left out: {self.reason}"
