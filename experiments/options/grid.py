"""Options of `trackslip grid`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from experiments.config import GridConfig
from trackslip.errors import InvalidValueError

MOST_JOBS = 1024
_EXECUTORS = "processes, inline, mpi or dask://HOST:PORT"


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
        if not 0 <= self.jobs <= MOST_JOBS:
            raise InvalidValueError("jobs", self.jobs, f"an integer from 0 to {MOST_JOBS}")
