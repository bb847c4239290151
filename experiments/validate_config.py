"""Options of `trackslip validate`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from experiments.config import MOST_THREADS
from trackslip.errors import InvalidValueError


@dataclass(frozen=True)
class ValidateConfig:
    """Hold the simulator against theory: turning, loads, slopes, step length, solver, energy."""

    robot: Path | None = None
    """A robot file, as calibrate writes it; by default the shipped robot."""
    seed: int = 0
    """Of the random commands."""
    threads: int = 0
    """Worker threads, 0 for one per processor; the results are the same."""
    out: Path = Path("out/validate")
    """Folder for the results."""

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise InvalidValueError("seed", self.seed, "an integer >= 0")
        if not 0 <= self.threads <= MOST_THREADS:
            raise InvalidValueError("threads", self.threads, f"an integer from 0 to {MOST_THREADS}")
