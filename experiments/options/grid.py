"""Options of `trackslip grid`, and those it shares with other commands that drive a grid."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from experiments.options import checks
from experiments.options.base import Distinct, Positive, Within
from experiments.options.help import default_is
from experiments.options.world import MAX_DURATION, MAX_JOBS, MAX_RADIUS, MIN_DURATION, Localization, Method, Simulation
from trackslip.errors import InvalidValueError
from trackslip.paper import COMMANDED_RADII, SPEEDS


@dataclass(frozen=True)
class RunsConfig(Simulation):
    """Runs of constant command, radius x speed, in front of the scanner."""

    radii: Annotated[tuple[float, ...], Distinct("number"), Positive(MAX_RADIUS)] = COMMANDED_RADII
    """Commanded radii, to the left, as if nothing slipped [m]."""
    speeds: Annotated[tuple[float, ...], Distinct("number")] = SPEEDS
    """Commanded speeds, as if nothing slipped [m/s]."""
    localization: Localization = "plate"
    """How a pose is estimated from a scan: maximum likelihood with the known plate, or the paper's line fit."""
    duration: Annotated[float, Within(MIN_DURATION, MAX_DURATION, "s")] = 30.0
    """Length of each run [s]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for speed in self.speeds:
            checks.require_speed("speeds", speed, self.drive.top_speed)


@dataclass(frozen=True)
class GridConfig(RunsConfig):
    """A grid of runs that is also evaluated."""

    motion: Method = None
    """How a run becomes a twist: the paper's filter, the filter both ways, an arc through all poses, or all ranges."""
    random_phase: bool = False
    """Start each run at a random point of its circle instead of the point nearest to the scanner."""
    out: Path = Path("out/grid")
    """Folder for the results."""


@dataclass(frozen=True)
class SweepConfig(GridConfig):
    """Drive a grid of runs, radius x speed x any other option, in front of the scanner, and store them.

    An interrupted grid resumes: runs that are already stored in OUT are not driven again.
    """

    grounds: Annotated[tuple[str, ...] | None, default_is("--ground", "NAME|FILE ...")] = None
    """Grounds to drive on, by name or .toml file."""
    friction_ratio: Annotated[tuple[float, ...] | None, default_is("the ground's", "FLOAT ...")] = None
    """Ratios of the friction across the track to that along it [-]."""
    slope: Annotated[tuple[float, ...] | None, default_is("--ground.slope", "FLOAT ...")] = None
    """Angles of the ground to the horizontal [rad]."""
    seeds: Annotated[tuple[int, ...] | None, default_is("--seed", "INT ...")] = None
    """Seeds; every run is driven once with each."""
    vary: Annotated[tuple[str, ...] | None, default_is("nothing", "NAME=VALUE,... ...")] = None
    """Any other options, each with its values: scanner.noise=0.005,0.01 robot.half_gauge=0.15,0.2."""
    sweep: Annotated[Path | None, default_is("none", "FILE")] = None
    """A .toml file of lists of values by name: radius, speed, ground, friction_ratio, slope, seed, or as for --vary."""
    executor: Annotated[str, default_is("processes", "{processes,inline,dask://HOST:PORT}")] = "processes"
    """Where the runs are driven: in worker processes, in this process, or on a Dask cluster."""
    jobs: int = 0
    """Number of processes, 0 for one per processor."""
    bag: bool = False
    """Also write a ROS 2 bag of each run to OUT/bags."""
    resume: bool = True
    """Keep the runs that OUT already has; --no-resume drives all of them again."""
    force: bool = False
    """Keep them even if code, models or libraries have changed since."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("grounds", "friction_ratio", "slope", "seeds", "vary"):
            checks.require_distinct(name, getattr(self, name))
        if self.executor not in ("processes", "inline") and not re.fullmatch(r"dask://.+:\d+", self.executor):
            raise InvalidValueError("executor", self.executor, "processes, inline or dask://HOST:PORT")
        checks.require_integer("jobs", self.jobs, 0, MAX_JOBS)
        if self.executor != "processes":
            checks.refuse_unused(self, ("jobs",), f"with --executor {self.executor}")
        if not self.resume:
            checks.refuse_unused(self, ("force",), "with --no-resume")
