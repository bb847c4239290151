"""The runs of a benchmark: suites, names, ids, starts."""

from __future__ import annotations

import functools
import importlib.util
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.benchmark.config import Config
from experiments.common.choices import CONTROLLER_NAMES, REFERENCE_NAMES, TRAINING_PATHS
from experiments.common.lookup import policy_path, reference, user_modules
from experiments.common.manifest import content, digest
from experiments.common.results import SUMMARY_FILE
from sim.seeds import generator
from trackslip import se2
from trackslip.controllers.named import CONTROLLERS
from trackslip.kinematics import Array
from trackslip.slip.law_file import SHIPPED

if TYPE_CHECKING:
    from experiments.benchmark.drive import ClosedLoops


FACTORS = ("controller", "compensation", "reference", "ground", "start", "seed")
"""Axes along which the runs of a benchmark differ: the fields of a BenchmarkCase."""
_PAPER = ("none", "published", "exponential", "icr_radius", "online")
_THREE = ("none", "icr_radius", "online")
_UNSEEN = tuple(name for name in REFERENCE_NAMES if name not in TRAINING_PATHS)


@dataclass(frozen=True)
class Suite:
    """The runs of a benchmark."""

    designs: Sequence[Sequence[tuple[Any, ...]]]
    """Full factorial designs: the values of each of FACTORS, all combined."""
    plants: str
    """"nominal", the robot that the laws were identified on, or "drawn" around it."""
    gains: str
    """"default" or "tuned", see `Gains.load`."""


SUITES: Mapping[str, Suite] = {
    "paper": Suite(
        [
            (("feedforward",), _PAPER, ("paper",), ("stone",), ("zero",), (0, 1, 2, 3, 4)),
            (("linear",), _PAPER, ("paper",), ("stone",), ("paper", "zero"), (0, 1, 2, 3, 4)),
        ],
        plants="nominal",
        gains="default",
    ),
    "fair": Suite(
        [(CONTROLLER_NAMES, _THREE, _UNSEEN, ("stone",), ("random",), tuple(range(8)))],
        plants="drawn",
        gains="tuned",
    ),
    "full": Suite(
        [(CONTROLLER_NAMES, _THREE, REFERENCE_NAMES, ("stone", "ice", "sticky"), ("random",), (0, 1, 2))],
        plants="drawn",
        gains="tuned",
    ),
}
"""Suites by name."""
_PAPER_OFFSET = (-0.2, -0.3, -np.pi / 6)  # forward, left, heading: Sec. IV-C, (0.3, -0.2, pi/3) from (0, 0, pi/2)
_MAX_OFFSET, _MAX_ROTATION = 0.15, np.radians(20)  # of a random start [m, rad]


@dataclass(frozen=True)
class BenchmarkCase:
    """One run: the names of its controller, compensation, reference, ground and start, and its seed."""

    controller: str
    compensation: str
    reference: str
    ground: str
    start: str
    seed: int
    id: str = ""
    """Hash of everything that its numbers depend on, the contents of files included."""

    @property
    def name(self) -> str:
        """The run's name."""
        return " ".join(map(str, self.axes.values()))

    @property
    def axes(self) -> dict[str, Any]:
        """The values of FACTORS."""
        return {name: getattr(self, name) for name in FACTORS}

    @property
    def fleet(self) -> str:
        """See Planned: robots on one reference are driven together."""
        return self.reference

    @property
    def duration(self) -> float:
        """Simulated time [s]."""
        return reference(self.reference).duration

    @property
    def key(self) -> str:
        """Key of the random numbers besides the seed: the reference's name, without the folder of its file."""
        return Path(self.reference).stem

    def start_pose(self) -> Array:
        """Start pose (3,) [m, m, rad]."""
        offset = np.zeros(3)
        if self.start == "paper":
            offset = np.array(_PAPER_OFFSET)
        elif self.start == "random":
            rng = generator(self.seed, f"start {self.key}")
            away, bearing = _MAX_OFFSET * np.sqrt(rng.uniform()), rng.uniform(-np.pi, np.pi)
            turn = rng.uniform(-_MAX_ROTATION, _MAX_ROTATION)
            offset = np.array([*(away * se2.direction(bearing)), turn])
        return se2.compose(reference(self.reference).pose(0.0), offset)


def cases_of(config: Config) -> tuple[list[BenchmarkCase], list[str]]:
    """Every run once, and a note on each of a suite's controllers that is left out because its library is missing.

    A controller that is named by an option is not left out; looking it up refuses it.
    """
    given = (config.controllers, config.compensations, config.references, config.grounds, config.starts, config.seeds)
    found: dict[BenchmarkCase, None] = {}
    for design in SUITES[config.suite].designs:
        chosen = [own or suites for own, suites in zip(given, design, strict=True)]
        found |= dict.fromkeys(BenchmarkCase(*values) for values in product(*chosen))
    rest = [case for case in found if case.controller != "mpc"]
    if len(rest) == len(found) or "mpc" in (config.controllers or ()) or importlib.util.find_spec("casadi") is not None:
        return list(found), []
    return rest, ['mpc is left out: CasADi is not installed; pip install "trackslip[mpc]"']


def identified(cases: Sequence[BenchmarkCase], loops: ClosedLoops) -> list[BenchmarkCase]:
    """The cases with their ids; a user's controllers must have been imported."""
    config, world = loops.config, loops.world
    laws = config.laws or SHIPPED
    specified = [world.parameters, world.ground, world.radius_error, world.obstacles, world.pull, world.robot.digest]
    evaluated = [world.drive, config.scanner, config.localization, config.preview, loops.plants]
    common = digest([specified, evaluated, content(laws / SUMMARY_FILE if laws.is_dir() else laws)])
    contents = functools.cache(lambda name: content(Path(name)))
    modules = set(user_modules())

    def files(case: BenchmarkCase) -> dict[str, str]:
        names = {case.reference, case.ground, str(policy_path(case.controller) or "")}
        names |= set() if case.controller.partition(":")[0] in CONTROLLERS else modules
        return {name: found for name in sorted(names) if (found := contents(name)) is not None}

    return [replace(case, id=digest([common, case.axes, loops.specification(case), files(case)])) for case in cases]
