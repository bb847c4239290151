"""The options of `trackslip benchmark`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal

from experiments.common.choices import COMPENSATIONS, CONTROLLERS, GROUND_NAMES, REFERENCES
from experiments.common.options import Distinct, Whole, default_is
from experiments.simulate.options import MAX_JOBS, ClosedLoopOptions
from experiments.simulate.paths import WaypointOptions

EXAMPLES: Final = (
    ("every controller, tuned, on drawn plants", "trackslip benchmark"),
    ("Sec. IV of the paper", "trackslip benchmark --suite paper --out out/paper"),
    (
        "two controllers on ice",
        "trackslip benchmark --controllers linear lqr --grounds ice --out out/on-ice",
    ),
    (
        "your own controller, tuned by tune",
        "trackslip benchmark --controllers my:C linear --gains out/tune --out out/my",
    ),
)
ESSENTIAL: Final = (
    "suite",
    "controllers",
    "compensations",
    "references",
    "grounds",
    "seeds",
    "robot",
    "out",
    "overwrite",
)
Start = Literal["zero", "paper", "random"]
_GROUNDS: Final = f"{{{','.join(GROUND_NAMES)},robot,FILE.toml}} ..."


@dataclass(frozen=True)
class Config(ClosedLoopOptions, WaypointOptions):
    """Compare controllers, with and without slip compensation, on paths and grounds, and print a
    leaderboard.

    The --suite chooses the runs; --controllers, --compensations, --references, --grounds, --starts
    and --seeds replace parts of it. An interrupted benchmark resumes when it is run again with the
    same options.
    """

    suite: Literal["paper", "fair", "full"] = "fair"
    """Runs: the paper's Sec. IV, tuned controllers on drawn plants (fair), or on all paths and
    three grounds (full).
    """
    controllers: Annotated[
        tuple[str, ...] | None, Distinct(), default_is("the suite's", f"{CONTROLLERS} ...")
    ] = None
    """Controllers, such as linear or linear:stiffness=160, ppo:FOLDER from train, or your
    MODULE:CLASS.
    """
    compensations: Annotated[
        tuple[str, ...] | None, Distinct(), default_is("the suite's", f"{COMPENSATIONS} ...")
    ] = None
    """A LAW in --laws; online starts from icr_radius, online_load from icr_load in --laws,
    online_cold from no slip.
    """
    references: Annotated[
        tuple[str, ...] | None, Distinct(), default_is("the suite's", f"{REFERENCES} ...")
    ] = None
    """Paths that take more than 12 s; a .csv file has waypoints in the columns x,y[,yaw][,v]."""
    grounds: Annotated[tuple[str, ...] | None, Distinct(), default_is("the suite's", _GROUNDS)] = (
        None
    )
    """Grounds; sticky is stone whose friction rises after 20 s, robot is the ground of the --robot
    file.
    """
    starts: Annotated[
        tuple[Start, ...] | None, Distinct(), default_is("the suite's", "{zero,paper,random} ...")
    ] = None
    """Start poses: on the path, beside it as in the paper (0.36 m, 30 deg), or at random (up to
    0.15 m, 20 deg).
    """
    seeds: Annotated[
        tuple[int, ...] | None, Distinct(), Whole(), default_is("the suite's", "INT ...")
    ] = None
    """Seeds for plants, random starts and scanner noise, the same for all controllers and
    compensations.
    """
    plants: Annotated[
        Literal["nominal", "drawn"] | None, default_is("the suite's", "{nominal,drawn}")
    ] = None
    """Robots: nominal for the robot that the laws belong to, drawn for random changes of robot,
    ground and scanner.
    """
    gains: Annotated[str | None, default_is("the suite's", "{default,tuned,FOLDER}")] = None
    """Controller gains: class defaults, the shipped tuned gains, or tune's gains in FOLDER (shipped
    where missing).
    """
    jobs: Annotated[int, Whole(0, MAX_JOBS)] = 0
    """Number of processes, 0 for one per processor; the results don't depend on it."""
    out: Path = Path("out/benchmark")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figures as PDF."""
