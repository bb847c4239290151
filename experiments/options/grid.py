"""Options of `trackslip grid`, and of the commands that drive one."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from experiments.options.world import (
    MAX_DURATION,
    MAX_RADIUS,
    MIN_DURATION,
    MIN_SPEED,
    Localization,
    Motion,
    Simulation,
)
from trackslip.errors import InvalidValueError, require_at_most, require_positive
from trackslip.paper import COMMANDED_RADII, SPEEDS

MAX_JOBS = 1024
_EXECUTORS = "processes, inline, mpi or dask://HOST:PORT"


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
    """How a run becomes a twist: the paper's filter as printed (paper) or run both ways (butterworth), or an arc of
    constant twist fitted to all poses (arc) or directly to all ranges (bundle); by default the most accurate method
    that the run allows."""
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
                require_at_most(name, value, MAX_RADIUS)
        for speed in self.speeds:
            if speed > self.drive.top_speed:
                raise InvalidValueError("speeds", speed, f"at most drive.top_speed = {self.drive.top_speed} m/s")
            if speed < MIN_SPEED:
                raise InvalidValueError("speeds", speed, f"at least {MIN_SPEED:g} m/s")
        if not MIN_DURATION <= self.duration <= MAX_DURATION:
            raise InvalidValueError("duration", self.duration, f"from {MIN_DURATION:g} to {MAX_DURATION:g} s")


@dataclass(frozen=True)
class SweepConfig(GridConfig):
    """Drive a grid of runs, radius x speed and whatever else is to vary, in front of the scanner, and store them.

    A grid that was stopped goes on where it was; runs that are stored in OUT already aren't driven again.
    """

    grounds: tuple[str, ...] = ()
    """Grounds to drive on, by name or .toml file, in place of --ground."""
    friction_ratio: tuple[float, ...] = ()
    """Ratios of the friction across the track to that along it."""
    slope: tuple[float, ...] = ()
    """Angles of the ground to the horizontal [rad]."""
    seeds: tuple[int, ...] = ()
    """Roots of all random numbers, in place of --seed: every run once with each."""
    vary: tuple[str, ...] = ()
    """Any other option as NAME=VALUE,VALUE: scanner.noise=0.005,0.01 or robot.half_gauge=0.15,0.2."""
    sweep: Path | None = None
    """A .toml file with a list of values for each name: radius, speed, ground, friction_ratio, slope, seed, and any
    that --vary takes."""
    executor: str = "processes"
    """Where runs are driven: processes, inline, mpi or dask://HOST:PORT."""
    jobs: int = 0
    """Number of processes, 0 for one per processor."""
    resume: bool = True
    """Take what OUT has already of these runs; --no-resume drives them all anew."""
    force: bool = False
    """Take them though code, models or libraries have changed since."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.executor not in ("processes", "inline", "mpi") and not re.fullmatch(r"dask://.+:\d+", self.executor):
            raise InvalidValueError("executor", self.executor, _EXECUTORS)
        if not 0 <= self.jobs <= MAX_JOBS:
            raise InvalidValueError("jobs", self.jobs, f"an integer from 0 to {MAX_JOBS}")
