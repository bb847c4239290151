"""Options of `trackslip sensitivity`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from experiments.options.grid import GridConfig
from trackslip.errors import InvalidValueError

MIRROR_PERIOD = 1 / 75
"""One revolution of the mirror of a SICK LMS 200, the longest sweep that is tried [s]."""


@dataclass(frozen=True)
class SensitivityConfig(GridConfig):
    """Drive the grid again and again, each time with something else wrong, and print what it does to slip."""

    out: Path = Path("out/sensitivity")
    """Folder for the results."""
    pdf: bool = False
    """Write the figures as PDF, too."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.scanner.period < MIRROR_PERIOD:
            raise InvalidValueError(
                "scanner.rate",
                self.scanner.rate,
                f"at most {1 / MIRROR_PERIOD:g} Hz, to leave time for the sweep that is tried",
            )
