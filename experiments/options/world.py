"""The commands' options, as frozen dataclasses that refuse what makes no sense. Importing this starts no simulator."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from sim.drive.drive import MAX_RADIUS_ERROR, Drive
from sim.ground.ground import Ground
from sim.scanner.scanner import LaserScanner
from trackslip.errors import InvalidValueError

Localization = Literal["plate", "line"]
Motion = Literal["paper", "butterworth", "arc", "bundle"]
IDENTIFIED = ("exponential", "icr", "icr_radius")
"""The identified laws that the paper's controllers are compared with."""

MAX_THREADS = 1024
MAX_PREVIEW = 1.0
"""[s]"""
MIN_SPEED = 1e-3
"""Slowest run of a grid [m/s]."""
MAX_DURATION = 3600.0
"""Longest run [s]."""
MIN_DURATION = 4.0
"""Shortest run that leaves something steady to average [s]."""
MAX_RADIUS = 1000.0
"""Largest radius [m]."""
MIN_RADIUS = 1e-3
"""Smallest radius [m]."""
MIN_FRICTION_RATIO = 0.01
"""Of friction across to along."""
MAX_COORDINATE = 100.0
"""Largest coordinate of a start [m]."""
LINEAR_START = (0.3, -0.2, math.pi / 3)
"""Where the paper starts its linear controller: (x, y, phi) (Sec. IV-C) [m, m, rad]."""


@dataclass(frozen=True)
class GroundOptions:
    """The ground, and what of it is to be another."""

    source: Annotated[str | None, tyro.conf.arg(name="", metavar="NAME|FILE")] = None
    """stone, concrete, rubber, packed_soil, gravel, wet, ice, or a .toml file; by default the robot's, else stone."""
    along: float | None = None
    """Friction coefficient along the track [-]."""
    across: float | None = None
    """Friction coefficient across the track [-]."""
    slope: float | None = None
    """Angle of the ground to the horizontal [rad]."""
    uphill: float | None = None
    """Heading of a robot that drives straight up the slope [rad]."""

    def __post_init__(self) -> None:
        self.changed(Ground())

    def changed(self, ground: Ground) -> Ground:
        """A ground with what is given here in place of its own."""
        given = {name: getattr(self, name) for name in ("along", "across", "slope", "uphill")}
        return replace(ground, **{name: value for name, value in given.items() if value is not None})


@dataclass(frozen=True)
class Repeatable:
    """What every command has that simulates."""

    seed: int = 0
    """Root of all random numbers."""
    threads: int = 0
    """Worker threads, 0 for one per processor; the results are the same."""

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise InvalidValueError("seed", self.seed, "an integer >= 0")
        if not 0 <= self.threads <= MAX_THREADS:
            raise InvalidValueError("threads", self.threads, f"an integer from 0 to {MAX_THREADS}")


@dataclass(frozen=True)
class Equipment:
    """The robot and its field, but for the ground."""

    robot: Path | None = None
    """A robot file, as calibrate writes it: the robot's parameters and its ground; by default the shipped robot."""
    radius_error: float | None = None
    """Relative error of the effective sprocket radius, real / nominal - 1; by default the robot's."""
    drive: Drive = field(default_factory=Drive)
    scanner: LaserScanner = field(default_factory=LaserScanner)
    obstacles: Annotated[str | None, tyro.conf.arg(metavar="NAME|FILE")] = None
    """What the scanner sees besides the plate: posts, room, walker, occluded, or a .toml file; by default nothing."""
    rrd: bool = False
    """Also write recordings for the rerun viewer, to OUT/recordings."""

    def __post_init__(self) -> None:
        if self.radius_error is not None and not abs(self.radius_error) <= MAX_RADIUS_ERROR:
            raise InvalidValueError("radius_error", self.radius_error, "from -0.5 to 0.5")
        scan_periods = self.scanner.period / self.drive.period
        if abs(scan_periods - round(scan_periods)) > 1e-6 or scan_periods < 0.5:
            raise InvalidValueError(
                "scanner.rate",
                self.scanner.rate,
                f"such that the time between scans is a multiple of drive.period = {self.drive.period} s",
            )


@dataclass(frozen=True)
class Simulation(Repeatable, Equipment):
    """The simulated world, the same for every command that drives."""

    ground: GroundOptions = field(default_factory=GroundOptions)

    def __post_init__(self) -> None:
        Repeatable.__post_init__(self)
        Equipment.__post_init__(self)
