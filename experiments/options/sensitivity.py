"""Options of `trackslip sensitivity`."""

from dataclasses import dataclass
from pathlib import Path

from experiments.options.grid import GridConfig
from trackslip.errors import InvalidValueError

MIRROR_PERIOD = 1 / 75
"""Time from the first beam of a scan to the last of a SICK LMS 200, whose mirror makes 75 revolutions a second [s]."""


@dataclass(frozen=True)
class SensitivityConfig(GridConfig):
    """Drive the grid repeatedly, each time with another disturbance of the scanner, its mounting or the field, and
    print the slip errors it causes."""

    out: Path = Path("out/sensitivity")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figures as PDF."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.scanner.period < MIRROR_PERIOD:
            allowed = f"at most {1 / MIRROR_PERIOD:g} Hz, to leave time for the scan duration that is tried"
            raise InvalidValueError("scanner.rate", self.scanner.rate, allowed)
