"""Options of `trackslip benchmark`, and the suites."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Literal

from experiments.options.world import MAX_PREVIEW, Equipment, Simulation
from trackslip.errors import InvalidValueError

Start = Literal["zero", "paper", "random"]
MAX_JOBS = 1024
CONTROLLER_NAMES = (
    *("feedforward", "linear", "samson", "kanayama", "dynamic_feedback", "offset_point"),
    *("pure_pursuit", "stanley", "lqr", "mpc"),
)
"""Those of trackslip.controllers, which this doesn't import, so that asking for help is quick."""
REFERENCE_NAMES = ("paper", "circle", "figure_eight", "slalom", "rounded_square", "clothoid", "spiral", "stop_and_go")
"""Those of trackslip.trajectory, likewise."""


@dataclass(frozen=True)
class Case:
    """One run of a benchmark, by the names of what is in it."""

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


@dataclass(frozen=True)
class Factors:
    """A full factorial: every controller with every compensation, and so on."""

    controllers: tuple[str, ...]
    compensations: tuple[str, ...]
    references: tuple[str, ...]
    grounds: tuple[str, ...]
    starts: tuple[Start, ...]
    seeds: tuple[int, ...]

    def cases(self) -> list[Case]:
        """Every run."""
        factors = (self.controllers, self.compensations, self.references, self.grounds, self.starts, self.seeds)
        return [Case(*values) for values in product(*factors)]


_PAPER = ("none", "published", "exponential", "icr_radius", "online")
SUITES: dict[str, tuple[Factors, ...]] = {
    "paper": (
        Factors(("feedforward",), _PAPER, ("paper",), ("stone",), ("zero",), (0, 1, 2, 3, 4)),
        Factors(("linear",), _PAPER, ("paper",), ("stone",), ("paper", "zero"), (0, 1, 2, 3, 4)),
    ),
    "quick": (Factors(CONTROLLER_NAMES, ("none", "icr_radius"), ("paper",), ("stone",), ("random",), (0, 1, 2)),),
    "full": (
        Factors(
            CONTROLLER_NAMES,
            ("none", "icr_radius", "online"),
            REFERENCE_NAMES,
            ("stone", "ice", "sticky"),
            ("random",),
            (0, 1, 2),
        ),
    ),
}
"""Suites by name: the union of factorials."""


@dataclass(frozen=True)
class BenchmarkConfig(Equipment):
    """Compare controllers, with and without compensation of slip, on paths and grounds, and print a leaderboard."""

    suite: Literal["paper", "quick", "full"] = "quick"
    """Which runs: Sec. IV of the paper with five seeds, every controller on one path, or on everything. What is given
    below takes the place of the suite's."""
    controllers: tuple[str, ...] | None = None
    """feedforward, linear, samson, kanayama, dynamic_feedback, offset_point, pure_pursuit, stanley, lqr, mpc, or your
    own as MODULE:CLASS."""
    compensations: tuple[str, ...] | None = None
    """none, published, a law in --laws (exponential, icr, icr_radius, ...), or found while driving: online, that begins
    with the law icr_radius, or online_cold, that begins with none."""
    references: tuple[str, ...] | None = None
    """paper, circle, figure_eight, slalom, rounded_square, clothoid, spiral, stop_and_go, or .csv files of way points
    with the columns x, y."""
    grounds: tuple[str, ...] | None = None
    """stone, concrete, rubber, packed_soil, gravel, wet, ice, sticky (stone that grows stickier after 20 s), .toml
    files, or robot, that of the --robot file."""
    starts: tuple[Start, ...] | None = None
    """Where robots are set down: where the reference begins; beside it as the paper's was (0.36 m, 30 deg); or at
    random up to 0.15 m and 20 deg off."""
    seeds: tuple[int, ...] | None = None
    """Seeds of the scanner's noise and of random starts, the same for all controllers and compensations."""
    localization: Literal["plate", "line", "truth"] = "plate"
    """How the controllers learn their pose."""
    preview: float = 0.0
    """How far ahead controllers are asked what to drive: 0.075 s makes up for the lag of servo and sampling [s]."""
    laws: Path | None = None
    """Where identified laws come from: a summary.json or a folder with one; by default those in the package."""
    jobs: int = 0
    """Processes, 0 for one per processor; the results are the same."""
    out: Path = Path("out/benchmark")
    """Folder for the results. If the command is stopped, the next one with the same options goes on from there."""
    pdf: bool = False
    """Write the figures as PDF, too."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.jobs <= MAX_JOBS:
            raise InvalidValueError("jobs", self.jobs, f"an integer from 0 to {MAX_JOBS}")
        if not 0 <= self.preview <= MAX_PREVIEW:
            raise InvalidValueError("preview", self.preview, f"from 0 to {MAX_PREVIEW:g} s")
        for seed in self.seeds or ():
            if seed < 0:
                raise InvalidValueError("seeds", seed, "integers >= 0")
        for name in ("controllers", "compensations", "references", "grounds", "starts", "seeds"):
            values = getattr(self, name)
            if values == ():
                raise InvalidValueError(name, values, "at least one")
            if values is not None and len(set(values)) < len(values):
                raise InvalidValueError(name, values, "all different")

    def cases(self) -> list[Case]:
        """Every run, once."""
        cases: dict[Case, None] = {}
        for block in SUITES[self.suite]:
            chosen = Factors(
                self.controllers or block.controllers,
                self.compensations or block.compensations,
                self.references or block.references,
                self.grounds or block.grounds,
                self.starts or block.starts,
                self.seeds or block.seeds,
            )
            cases |= dict.fromkeys(chosen.cases())
        return list(cases)

    def simulation(self) -> Simulation:
        """The same world for a single process."""
        return Simulation(self.robot, self.radius_error, self.drive, self.scanner, self.obstacles, threads=1)
