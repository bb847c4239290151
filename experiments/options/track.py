"""Options of `trackslip track`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from experiments.options.world import (
    MAX_COORDINATE,
    MAX_DURATION,
    MAX_PREVIEW,
    MAX_RADIUS,
    MIN_SPEED,
    Simulation,
)
from trackslip.errors import InvalidValueError, require_at_most, require_positive


@dataclass(frozen=True)
class TrackConfig(Simulation):
    """Follow a path once, in closed loop through the scanner, and print the errors."""

    controller: str = "linear"
    """Who drives: feedforward, linear (the paper's Eq. 31), samson, kanayama, dynamic_feedback, offset_point,
    pure_pursuit, stanley, lqr, mpc, or your own as MODULE:CLASS."""
    compensation: str = "icr_radius"
    """What turns a twist into sprocket speeds: none, published, a law in --laws (exponential, icr, icr_radius, ...), or
    one found while driving, online or online_cold (see benchmark)."""
    preview: float = 0.0
    """How far ahead the controller is asked what to drive: 0.075 s makes up for the lag of servo and sampling [s]."""
    localization: Literal["plate", "line", "truth"] = "plate"
    """How the controller learns its pose."""
    reference: str = "paper"
    """The path: the paper's (45.8 s), a circle in front of the scanner, figure_eight, slalom, rounded_square, clothoid,
    spiral, stop_and_go, or a .csv file of way points with the columns x, y."""
    circle_radius: float = 1.25
    """Radius of the circle, to the left [m]."""
    circle_speed: float = 0.15
    """Speed on the circle [m/s]."""
    circle_duration: float = 45.0
    """Time on the circle [s]."""
    start: Annotated[tuple[float, float, float] | None, tyro.conf.arg(metavar="X Y PHI")] = None
    """Start pose [m, m, rad]; by default (0.3, -0.2, pi/3) for linear on the paper's path, as in the paper, else the
    reference's own."""
    laws: Path | None = None
    """Where identified laws come from: a summary.json or a folder with one; by default those in the package."""
    out: Path = Path("out/track")
    """Folder for the results."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.preview <= MAX_PREVIEW:
            raise InvalidValueError("preview", self.preview, f"from 0 to {MAX_PREVIEW:g} s")
        for name in ("circle_radius", "circle_speed", "circle_duration"):
            require_positive(name, getattr(self, name))
        if self.circle_speed > self.drive.top_speed:
            raise InvalidValueError(
                "circle_speed", self.circle_speed, f"at most drive.top_speed = {self.drive.top_speed} m/s"
            )
        require_at_most("circle_duration", self.circle_duration, MAX_DURATION, "s")
        if not 0.1 <= self.circle_radius <= MAX_RADIUS:
            raise InvalidValueError("circle_radius", self.circle_radius, f"from 0.1 to {MAX_RADIUS:g} m")
        if self.circle_speed < MIN_SPEED:
            raise InvalidValueError("circle_speed", self.circle_speed, f"at least {MIN_SPEED:g} m/s")
        if self.circle_duration < 1.0:
            raise InvalidValueError("circle_duration", self.circle_duration, "at least 1 s")
        for value in self.start or ():
            if not -MAX_COORDINATE <= value <= MAX_COORDINATE:
                raise InvalidValueError("start", value, f"from -{MAX_COORDINATE:g} to {MAX_COORDINATE:g}")
