"""Options of `trackslip track`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from experiments.options.checks import default_is, refuse_unused, require_between
from experiments.options.world import MAX_COORDINATE, MAX_DURATION, MAX_PREVIEW, MAX_RADIUS, MIN_SPEED, Simulation
from trackslip.errors import InvalidValueError, require_positive

WITHOUT_LAWS = ("none", "published", "online_cold")
"""Compensations that need no identified law."""


@dataclass(frozen=True)
class TrackConfig(Simulation):
    """Follow a path once in closed loop, localising with the scanner, and print the errors."""

    controller: str = "linear"
    """Controller: feedforward, linear (the paper's Eq. 31), samson, kanayama, dynamic_feedback, offset_point,
    pure_pursuit, stanley, lqr, mpc, ppo:FOLDER of a trained policy, or your own as MODULE:CLASS."""
    compensation: str = "icr_radius"
    """Slip compensation: none, published, a law in --laws (exponential, icr, icr_radius, ...), or a law identified
    while driving, online or online_cold (see benchmark)."""
    preview: float = 0.0
    """How far ahead of now the controller tracks the reference; 0.075 s compensates for the lag of servo and
    sampling [s]."""
    localization: Literal["plate", "line", "truth"] = "plate"
    """How the controller learns its pose: from scans by the plate or the line method, or the true pose."""
    reference: str = "paper"
    """Path: the paper's (45.8 s), circle (in front of the scanner), figure_eight, slalom, rounded_square, clothoid,
    spiral, stop_and_go, or a .csv file of way points with the columns x, y."""
    circle_radius: float = 1.25
    """Radius of the circle, to the left; needs --reference circle [m]."""
    circle_speed: float = 0.15
    """Speed on the circle; needs --reference circle [m/s]."""
    circle_duration: float = 45.0
    """Time on the circle; needs --reference circle [s]."""
    start: Annotated[
        tuple[float, float, float] | None,
        default_is("0.3 -0.2 1.0472, as in the paper, for linear on the paper's path; else the reference's", "X Y PHI"),
    ] = None
    """Start pose [m, m, rad]."""
    laws: Annotated[Path | None, default_is("the laws shipped with trackslip", "PATH")] = None
    """Identified laws: a summary.json, or a folder that contains one."""
    out: Path = Path("out/track")
    """Folder for the results."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_between("preview", self.preview, 0, MAX_PREVIEW, "s")
        for name in ("circle_radius", "circle_speed", "circle_duration"):
            require_positive(name, getattr(self, name))
        if self.circle_speed > self.drive.top_speed:
            raise InvalidValueError(
                "circle_speed", self.circle_speed, f"at most drive.top_speed = {self.drive.top_speed} m/s"
            )
        require_between("circle_duration", self.circle_duration, 1.0, MAX_DURATION, "s")
        require_between("circle_radius", self.circle_radius, 0.1, MAX_RADIUS, "m")
        if self.circle_speed < MIN_SPEED:
            raise InvalidValueError("circle_speed", self.circle_speed, f"at least {MIN_SPEED:g} m/s")
        if self.reference != "circle":
            refuse_unused(self, ("circle_radius", "circle_speed", "circle_duration"), "without --reference circle")
        if self.compensation in WITHOUT_LAWS:
            refuse_unused(self, ("laws",), f"with --compensation {self.compensation}")
        for value in self.start or ():
            require_between("start", value, -MAX_COORDINATE, MAX_COORDINATE)
