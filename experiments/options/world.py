"""The commands' options, as frozen dataclasses that refuse what makes no sense. Importing this starts no simulator."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from sim.drive import LARGEST_RADIUS_ERROR, Drive
from sim.ground import Ground
from sim.scanner import LaserScanner
from trackslip.errors import InvalidValueError, require_at_most, require_non_negative, require_positive
from trackslip.published import COMMANDED_RADII, OBSERVED_RADII, SPEEDS
from trackslip.steady import SETTLE

Localization = Literal["plate", "line"]
Motion = Literal["paper", "butterworth", "savgol", "rts", "arc", "bundle"]
IDENTIFIED = ("exponential", "icr", "icr_radius")
"""The identified laws that the paper's controllers are compared with."""

MOST_THREADS = 1024
LONGEST_PREVIEW = 1.0
"""[s]"""
SLOWEST = 1e-3
"""Slowest run of a grid [m/s]."""
LONGEST_RUN = 3600.0
"""Longest run [s]."""
SHORTEST_RUN = 4.0
"""Shortest run that leaves something steady to average [s]."""
WIDEST = 1000.0
"""Largest radius [m]."""
SMALLEST = 1e-3
"""Smallest radius [m]."""
LOWEST_RATIO = 0.01
"""Of friction across to along."""
FARTHEST = 100.0
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
        if not 0 <= self.threads <= MOST_THREADS:
            raise InvalidValueError("threads", self.threads, f"an integer from 0 to {MOST_THREADS}")


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
        if self.radius_error is not None and not abs(self.radius_error) <= LARGEST_RADIUS_ERROR:
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


@dataclass(frozen=True)
class GridConfig(Simulation):
    """Drive the grid of runs, radius x speed, in front of the scanner, and store scans' poses and truth."""

    radii: tuple[float, ...] = COMMANDED_RADII
    """Radii of the no-slip commands, to the left [m]."""
    speeds: tuple[float, ...] = SPEEDS
    """Speeds of the no-slip commands [m/s]."""
    localization: Localization = "plate"
    """How a scan becomes a pose: the known rectangle's maximum likelihood, or the paper's line."""
    motion: Motion | None = None
    """How a run becomes a twist, by default the most exact way that it allows: the paper's filter as printed, or run
    both ways (butterworth); Savitzky and Golay's; a constant-twist smoother; the arc of constant twist through all
    poses, or straight to all ranges (bundle)."""
    duration: float = 30.0
    """Length of each run [s]."""
    random_phase: bool = False
    """Start each run anywhere on its circle, instead of where that is nearest to the scanner."""
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
                require_at_most(name, value, WIDEST)
        for speed in self.speeds:
            if speed > self.drive.top_speed:
                raise InvalidValueError("speeds", speed, f"at most drive.top_speed = {self.drive.top_speed} m/s")
            if speed < SLOWEST:
                raise InvalidValueError("speeds", speed, f"at least {SLOWEST:g} m/s")
        if not SHORTEST_RUN <= self.duration <= LONGEST_RUN:
            raise InvalidValueError("duration", self.duration, f"from {SHORTEST_RUN:g} to {LONGEST_RUN:g} s")


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
    """How a run becomes a twist: paper, butterworth, savgol, rts, arc, or, with ranges, bundle; by default the most
    exact that the run allows."""
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
        if not 0 <= self.preview <= LONGEST_PREVIEW:
            raise InvalidValueError("preview", self.preview, f"from 0 to {LONGEST_PREVIEW:g} s")
        for name in ("circle_radius", "circle_speed", "circle_duration"):
            require_positive(name, getattr(self, name))
        if self.circle_speed > self.drive.top_speed:
            raise InvalidValueError(
                "circle_speed", self.circle_speed, f"at most drive.top_speed = {self.drive.top_speed} m/s"
            )
        require_at_most("circle_duration", self.circle_duration, LONGEST_RUN, "s")
        if not 0.1 <= self.circle_radius <= WIDEST:
            raise InvalidValueError("circle_radius", self.circle_radius, f"from 0.1 to {WIDEST:g} m")
        if self.circle_speed < SLOWEST:
            raise InvalidValueError("circle_speed", self.circle_speed, f"at least {SLOWEST:g} m/s")
        if self.circle_duration < 1.0:
            raise InvalidValueError("circle_duration", self.circle_duration, "at least 1 s")
        for value in self.start or ():
            if not -FARTHEST <= value <= FARTHEST:
                raise InvalidValueError("start", value, f"from -{FARTHEST:g} to {FARTHEST:g}")


@dataclass(frozen=True)
class ReproduceConfig(GridConfig):
    """The whole paper: the grid, the slip laws from its scans, both controllers with and without them."""

    out: Path = Path("out/reproduce")
    """Folder for the results."""
    pdf: bool = False
    """Write the figures as PDF, too."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.radii) < 2:
            raise InvalidValueError("radii", self.radii, "at least two: slip laws are functions of radius")
        if len(self.radii) * len(self.speeds) < 3:
            raise InvalidValueError("speeds", self.speeds, "at least two for two radii: three runs or more")


@dataclass(frozen=True)
class PredictConfig:
    """A slip law from quasi-static Coulomb theory, without simulating."""

    robot: Path | None = None
    """A robot file: what isn't given below is taken from it; by default the shipped robot."""
    half_gauge: float | None = None
    """Half the distance between the tracks [m]; by default the robot's."""
    contact_length: float | None = None
    """Length of track on the ground [m]; by default the robot's."""
    friction_ratio: float | None = None
    """Friction across the track over friction along it, all that slip asks of the ground; by default the robot's."""
    com_x: float | None = None
    """Centre of mass, forward of the middle of the tracks [m]; by default the robot's."""
    sprocket_radius: float | None = None
    """Radius of the sprockets [m], stored with the law, slip doesn't depend on it; by default the robot's."""
    radius_error: float = 0.0
    """Relative error of the effective sprocket radius, real / nominal - 1."""
    radii: tuple[float, ...] = OBSERVED_RADII
    """Radii driven, for the table [m]."""
    out: Path = Path("out/predict")
    """Folder for the results."""

    def __post_init__(self) -> None:
        for name in ("half_gauge", "contact_length", "friction_ratio", "sprocket_radius"):
            if getattr(self, name) is not None:
                require_positive(name, getattr(self, name))
                require_at_most(name, getattr(self, name), 100.0)
        if not -LARGEST_RADIUS_ERROR <= self.radius_error <= LARGEST_RADIUS_ERROR:
            raise InvalidValueError("radius_error", self.radius_error, "from -0.5 to 0.5")
        if not self.radii:
            raise InvalidValueError("radii", self.radii, "at least one number")
        for radius in self.radii:
            require_positive("radii", radius)
            require_at_most("radii", radius, WIDEST, "m")
            if radius < SMALLEST:
                raise InvalidValueError("radii", radius, f"at least {SMALLEST:g} m")
        if self.friction_ratio is not None and self.friction_ratio < LOWEST_RATIO:
            raise InvalidValueError("friction_ratio", self.friction_ratio, f"at least {LOWEST_RATIO:g}")
