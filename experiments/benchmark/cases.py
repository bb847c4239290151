"""The runs of a benchmark: suites, and what one run is."""

import importlib.util
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from experiments.benchmark.config import Config
from experiments.common.choices import CONTROLLER_NAMES, REFERENCE_NAMES, TRAINING_PATHS
from experiments.common.lookup import reference
from sim.seeds import generator
from trackslip import se2
from trackslip.kinematics import Array

FACTORS = ("controller", "compensation", "reference", "ground", "start", "seed")
"""Axes along which the runs of a benchmark differ: the fields of a BenchmarkCase."""
_PAPER = ("none", "published", "exponential", "icr_radius", "online")
_THREE = ("none", "icr_radius", "online")
_UNSEEN = tuple(name for name in REFERENCE_NAMES if name not in TRAINING_PATHS)
_PAPER_OFFSET = (-0.2, -0.3, -np.pi / 6)  # forward, left, heading: Sec. IV-C, (0.3, -0.2, pi/3) from (0, 0, pi/2)
_MAX_OFFSET, _MAX_ROTATION = 0.15, np.radians(20)  # of a random start [m, rad]


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
            distance, bearing = _MAX_OFFSET * np.sqrt(rng.uniform()), rng.uniform(-np.pi, np.pi)
            rotation = rng.uniform(-_MAX_ROTATION, _MAX_ROTATION)
            offset = np.array([*(distance * se2.direction(bearing)), rotation])
        return se2.compose(reference(self.reference).pose(0.0), offset)


def planned_cases(config: Config) -> tuple[list[BenchmarkCase], list[str]]:
    """Every run once, and a note on each of a suite's controllers that is left out because its library is missing.

    A controller that is named by an option is not left out; looking it up refuses it.
    """
    options = (config.controllers, config.compensations, config.references, config.grounds, config.starts, config.seeds)
    cases: dict[BenchmarkCase, None] = {}
    for design in SUITES[config.suite].designs:
        values = [option or default for option, default in zip(options, design, strict=True)]
        cases |= dict.fromkeys(BenchmarkCase(*combination) for combination in product(*values))
    if config.controllers or importlib.util.find_spec("casadi"):
        return list(cases), []
    others = [case for case in cases if case.controller != "mpc"]
    notes = ['mpc is left out: CasADi is not installed; pip install "trackslip[mpc]"']
    return others, notes if len(others) < len(cases) else []
