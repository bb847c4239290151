"""The commands' options, as frozen dataclasses that refuse what makes no sense. Importing this starts no simulator."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from sim.drive import RADIUS_ERROR, Drive
from sim.ground import Ground
from sim.scanner import LaserScanner
from trackslip.errors import InvalidValueError, require_finite, require_non_negative, require_positive
from trackslip.published import COMMANDED_RADII, SPEEDS
from trackslip.steady import SETTLE

Localization = Literal["plate", "line"]
Compensation = Literal["none", "published", "exponential", "icr", "icr_radius"]

SHORTEST_RUN = 4.0
"""Shortest run that leaves something steady to average [s]."""
LINEAR_START = (0.3, -0.2, 1.0471975511965976)
"""Where the paper starts its linear controller: (x, y, phi) (Sec. IV-C) [m, m, rad]."""


@dataclass(frozen=True)
class Simulation:
    """The simulated world, the same for every command that drives."""

    seed: int = 0
    """Root of all random numbers."""
    threads: int = 0
    """Worker threads, 0 for one per processor; the results are the same."""
    radius_error: float = RADIUS_ERROR
    """Relative error of the effective sprocket radius, real / nominal - 1."""
    ground: Ground = field(default_factory=Ground)
    drive: Drive = field(default_factory=Drive)
    scanner: LaserScanner = field(default_factory=LaserScanner)

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise InvalidValueError("seed", self.seed, "an integer >= 0")
        if self.threads < 0:
            raise InvalidValueError("threads", self.threads, "an integer >= 0")
        require_finite("radius_error", self.radius_error)
        if self.radius_error <= -1:
            raise InvalidValueError("radius_error", self.radius_error, "> -1")
        scan_periods = self.scanner.period / self.drive.period
        if abs(scan_periods - round(scan_periods)) > 1e-6 or scan_periods < 0.5:
            raise InvalidValueError(
                "scanner.rate",
                self.scanner.rate,
                f"such that the time between scans is a multiple of drive.period = {self.drive.period} s",
            )


@dataclass(frozen=True)
class GridConfig(Simulation):
    """Drive the grid of runs, radius x speed, in front of the scanner, and store scans' poses and truth."""

    radii: tuple[float, ...] = COMMANDED_RADII
    """Radii of the no-slip commands, to the left [m]."""
    speeds: tuple[float, ...] = SPEEDS
    """Speeds of the no-slip commands [m/s]."""
    localization: Localization = "plate"
    """How a scan becomes a pose: the known rectangle's maximum likelihood, or the paper's line."""
    duration: float = 30.0
    """Length of each run [s]."""
    out: Path = Path("out/grid")
    """Folder for the results."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, values in (("radii", self.radii), ("speeds", self.speeds)):
            if not values:
                raise InvalidValueError(name, values, "at least one number")
            if len(set(values)) < len(values):
                raise InvalidValueError(name, values, "all different")
            for value in values:
                require_positive(name, value)
        for speed in self.speeds:
            if speed > self.drive.top_speed:
                raise InvalidValueError("speeds", speed, f"at most drive.top_speed = {self.drive.top_speed} m/s")
        if not SHORTEST_RUN <= self.duration < float("inf"):
            raise InvalidValueError("duration", self.duration, f"at least {SHORTEST_RUN:g} s")


@dataclass(frozen=True)
class IdentifyConfig:
    """Fit the slip laws to a stored grid, or to a log of a real robot, and print a table."""

    path: tyro.conf.Positional[Path]
    """Folder of a stored grid, or a .csv or .parquet log: run, t, omega_l, omega_r, x, y, phi (traces), or
    omega_l, omega_r, v, w (steady samples)."""
    half_gauge: float | None = None
    """Half the distance between the tracks [m]; by default the log's own."""
    sprocket_radius: float | None = None
    """Radius of the sprockets [m]; by default the log's own."""
    settle: float = SETTLE
    """Time at the start of each run that is not steady [s]."""
    out: Path = Path("out/identify")
    """Folder for the results."""

    def __post_init__(self) -> None:
        for name in ("half_gauge", "sprocket_radius"):
            if getattr(self, name) is not None:
                require_positive(name, getattr(self, name))
        require_non_negative("settle", self.settle)


@dataclass(frozen=True)
class TrackConfig(Simulation):
    """Follow a path once, in closed loop through the scanner, and print the errors."""

    controller: Literal["feedforward", "linear"] = "linear"
    """Who drives: the reference's own twist, or the paper's feedback law (Eq. 31)."""
    compensation: Compensation = "icr_radius"
    """The slip law that turns a twist into sprocket speeds."""
    localization: Literal["plate", "line", "truth"] = "plate"
    """How the controller learns its pose."""
    reference: Literal["paper", "circle"] = "paper"
    """The path: the paper's (45.8 s), or a circle in front of the scanner."""
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
        for name in ("circle_radius", "circle_speed", "circle_duration"):
            require_positive(name, getattr(self, name))
        if self.circle_speed > self.drive.top_speed:
            raise InvalidValueError(
                "circle_speed", self.circle_speed, f"at most drive.top_speed = {self.drive.top_speed} m/s"
            )
        for value in self.start or ():
            require_finite("start", value)


@dataclass(frozen=True)
class ReproduceConfig(GridConfig):
    """The whole paper: the grid, the slip laws from its scans, both controllers with and without them."""

    out: Path = Path("out/reproduce")
    """Folder for the results."""
