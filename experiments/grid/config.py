"""The options of `trackslip grid`."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Final

import tyro

from experiments.common.options import Distinct, Excludes, Exclusion, Needs, Whole, default_is
from experiments.simulate.grid_options import GridConfig
from experiments.simulate.options import MAX_JOBS
from trackslip.errors import InvalidValueError

EXAMPLES: Final = (
    ("the paper's 25 runs", "trackslip grid"),
    ("six runs", "trackslip grid --radii 0.5 1 2 --speeds 0.1 0.2 --out out/six"),
    ("on a gravel slope", "trackslip grid --ground gravel --ground.slope 0.1 --out out/slope"),
    (
        "with a noisier scanner",
        "trackslip grid --scanner.noise 0.01 --obstacles posts --out out/noisy",
    ),
    ("500 runs", "trackslip grid --grounds stone ice --seeds 0 1 2 3 4 5 6 7 8 9 --out out/500"),
    (
        "over any option",
        "trackslip grid --vary slope=0,0.1 robot.half_gauge=0.15,0.2 --out out/vary100",
    ),
    (
        "on a Dask cluster",
        "trackslip grid --sweep s.toml --executor dask://host:8786 --out out/dask",
    ),
)
ESSENTIAL: Final = (
    "robot",
    "ground.source",
    "radii",
    "speeds",
    "duration",
    "seed",
    "grounds",
    "seeds",
    "vary",
    "rrd",
    "out",
    "overwrite",
)


@dataclass(frozen=True)
class Config(GridConfig):
    """Drive a grid of runs, radius x speed x any other option, in front of the scanner, and store
    them.

    An interrupted grid resumes when it is run again; finished runs are not driven again.
    """

    grounds: Annotated[tuple[str, ...] | None, Distinct(), default_is("--ground", "GROUND ...")] = (
        None
    )
    """Grounds to drive on, by name or .toml file."""
    seeds: Annotated[tuple[int, ...] | None, Distinct(), default_is("--seed", "INT ...")] = None
    """Seeds; every run is driven once with each seed."""
    vary: Annotated[
        tuple[str, ...] | None, Distinct(), default_is("nothing", "NAME=VALUE,... ...")
    ] = None
    """Any other options, each with its values: scanner.noise=0.005,0.01 slope=0,0.1
    friction_ratio=1,1.2.
    """
    sweep: Annotated[Path | None, default_is("none", "FILE")] = None
    """A .toml file with a list of values per name: radius, speed, ground, seed, or any name that
    --vary accepts.
    """
    executor: Annotated[str, default_is("processes", "{processes,inline,dask://HOST:PORT}")] = (
        "processes"
    )
    """Executor for the runs: worker processes, this process (inline), or a Dask cluster."""
    jobs: Annotated[int, Whole(0, MAX_JOBS)] = 0
    """Number of processes, 0 for one per processor."""
    wait: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """If all workers of a Dask cluster have died, wait for others instead of stopping."""
    bag: bool = False
    """Also write each run as a ROS 2 bag to OUT/bags."""
    pdf: bool = False
    """Also write the figures as PDF."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Needs(("jobs",), "executor", ("processes",)),
        Excludes(("wait",), "executor", ("processes", "inline")),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.executor not in ("processes", "inline") and not re.fullmatch(
            r"dask://.+:\d+", self.executor
        ):
            raise InvalidValueError(
                "executor", self.executor, "processes, inline or dask://HOST:PORT"
            )
