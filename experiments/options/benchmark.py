"""Options of `trackslip benchmark`, and its suites of runs."""

from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

from experiments.options.checks import refuse_unused, require_between, require_distinct, require_integer
from experiments.options.choices import (
    COMPENSATIONS,
    CONTROLLER_NAMES,
    CONTROLLERS,
    REFERENCE_NAMES,
    REFERENCES,
    WITHOUT_LAWS,
)
from experiments.options.help import default_is
from experiments.options.world import MAX_JOBS, MAX_PREVIEW, Equipment, Simulation
from trackslip.errors import InvalidValueError

Start = Literal["zero", "paper", "random"]
_GROUNDS = "{stone,concrete,rubber,packed_soil,gravel,wet,ice,sticky,robot,FILE.toml} ..."


@dataclass(frozen=True)
class Case:
    """One run of a benchmark: the names of its controller, compensation, reference, ground and start, and its seed."""

    controller: str
    compensation: str
    reference: str
    ground: str
    start: str
    seed: int

    @property
    def run(self) -> str:
        """The run's name."""
        return f"{self.controller} {self.compensation} {self.reference} {self.ground} {self.start} {self.seed}"


_FACTORS = ("controllers", "compensations", "references", "grounds", "starts", "seeds")  # in the order of Case's fields
_PAPER = ("none", "published", "exponential", "icr_radius", "online")
_THREE = ("none", "icr_radius", "online")
_SUITES: dict[str, list[tuple[tuple[Any, ...], ...]]] = {
    "paper": [
        (("feedforward",), _PAPER, ("paper",), ("stone",), ("zero",), (0, 1, 2, 3, 4)),
        (("linear",), _PAPER, ("paper",), ("stone",), ("paper", "zero"), (0, 1, 2, 3, 4)),
    ],
    "quick": [(CONTROLLER_NAMES, ("none", "icr_radius"), ("paper",), ("stone",), ("random",), (0, 1, 2))],
    "full": [(CONTROLLER_NAMES, _THREE, REFERENCE_NAMES, ("stone", "ice", "sticky"), ("random",), (0, 1, 2))],
}
"""Suites by name, each the union of full factorial designs: the values of each of _FACTORS, all combined."""


@dataclass(frozen=True)
class BenchmarkConfig(Equipment):
    """Compare controllers, with and without slip compensation, on paths and grounds, and print a leaderboard.

    --suite chooses the runs; --controllers, --compensations, --references, --grounds, --starts and --seeds replace
    parts of it. An interrupted benchmark resumes when it is run again with the same options.
    """

    suite: Literal["paper", "quick", "full"] = "quick"
    """Runs: Sec. IV of the paper with five seeds, all controllers on one path, or on all paths and three grounds."""
    controllers: Annotated[tuple[str, ...] | None, default_is("the suite's", f"{CONTROLLERS} ...")] = None
    """Controllers; ppo:FOLDER is a policy trained by train, MODULE:CLASS a controller of your own."""
    compensations: Annotated[tuple[str, ...] | None, default_is("the suite's", f"{COMPENSATIONS} ...")] = None
    """Slip compensations: LAW of --laws; online starts from icr_radius, online_load icr_load, online_cold no slip."""
    references: Annotated[tuple[str, ...] | None, default_is("the suite's", f"{REFERENCES} ...")] = None
    """Paths; a .csv file lists way points in the columns x, y [m]."""
    grounds: Annotated[tuple[str, ...] | None, default_is("the suite's", _GROUNDS)] = None
    """Grounds; sticky is stone whose friction rises after 20 s, robot is the ground of the --robot file."""
    starts: Annotated[tuple[Start, ...] | None, default_is("the suite's", "{zero,paper,random} ...")] = None
    """Start poses: on the path, beside it as in the paper (0.36 m, 30 deg), or at random (up to 0.15 m, 20 deg)."""
    seeds: Annotated[tuple[int, ...] | None, default_is("the suite's", "INT ...")] = None
    """Seeds of the scanner's noise and of random starts, the same for all controllers and compensations."""
    localization: Literal["plate", "line", "truth"] = "plate"
    """How the controllers learn their pose: from scans by the plate or the line method, or the true pose."""
    preview: float = 0.0
    """Time by which the controllers look ahead on the path; 0.075 s makes up for the lag of servo and sampling [s]."""
    laws: Annotated[Path | None, default_is("the laws shipped with trackslip", "PATH")] = None
    """Identified laws: a summary.json, or a folder that contains one."""
    jobs: int = 0
    """Number of processes, 0 for one per processor; the results don't depend on it."""
    out: Path = Path("out/benchmark")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figures as PDF."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_integer("jobs", self.jobs, 0, MAX_JOBS)
        require_between("preview", self.preview, 0, MAX_PREVIEW, "s")
        for seed in self.seeds or ():
            if seed < 0:
                raise InvalidValueError("seeds", seed, "integers >= 0")
        for name in _FACTORS:
            require_distinct(name, getattr(self, name))
        if all(name in WITHOUT_LAWS for name in self.compensations or ("icr_radius",)):
            refuse_unused(self, ("laws",), f"with --compensations {' '.join(self.compensations or ())}")

    def cases(self) -> list[Case]:
        """Every run, once."""
        given = [getattr(self, name) for name in _FACTORS]
        cases: dict[Case, None] = {}
        for design in _SUITES[self.suite]:
            chosen = [own or suites for own, suites in zip(given, design, strict=True)]
            cases |= dict.fromkeys(Case(*values) for values in product(*chosen))
        return list(cases)

    def simulation(self) -> Simulation:
        """The same world for a single process."""
        equipment = self.robot, self.radius_error, self.drive, self.scanner, self.obstacles, self.pull
        return Simulation(*equipment, threads=1)
