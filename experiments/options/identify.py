"""Options of `trackslip identify`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from experiments.options.world import (
    Motion,
)
from trackslip.errors import require_at_most, require_non_negative, require_positive
from trackslip.motion.steady import SETTLE


@dataclass(frozen=True)
class IdentifyConfig:
    """Fit the slip laws to a stored grid, or to a log of a real robot, and print a table."""

    path: tyro.conf.Positional[Path]
    """Folder of a stored grid, or a .csv or .parquet log: run, t, omega_l, omega_r, x, y, phi (traces), or
    omega_l, omega_r, v, w (steady samples)."""
    where: tuple[str, ...] = ()
    """Which of a sweep's runs, as NAME=VALUE: ground=ice friction_ratio=1.2."""
    half_gauge: float | None = None
    """Half the distance between the tracks [m]; by default the log's own."""
    sprocket_radius: float | None = None
    """Radius of the sprockets [m]; by default the log's own."""
    gear: float = 1.0
    """Turns of the encoder, whose speed omega then is, for one of the sprocket."""
    motion: Motion | None = None
    """How a run becomes a twist: paper, butterworth, arc or, if the log has ranges, bundle; by default the most accurate
    method that the run allows."""
    settle: float = SETTLE
    """Time after the sprockets have become steady that is left out of each run [s]."""
    out: Path = Path("out/identify")
    """Folder for the results."""
    pdf: bool = False
    """Write the figures as PDF, too."""

    def __post_init__(self) -> None:
        for name in ("half_gauge", "sprocket_radius"):
            if getattr(self, name) is not None:
                require_positive(name, getattr(self, name))
                require_at_most(name, getattr(self, name), 100.0, "m")
        require_positive("gear", self.gear)
        require_at_most("gear", self.gear, 1e4)
        require_non_negative("settle", self.settle)
