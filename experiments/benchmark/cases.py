"""A benchmark's runs: suites, single cases, and plants that differ from the plant used to identify
the laws.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from experiments.benchmark.config import Config
from experiments.common.choices import CONTROLLER_NAMES, REFERENCE_NAMES, TRAINING_PATHS
from experiments.common.paths import PLAN, PathPlan
from sim.common.seeds import generator
from sim.motors.motor import or_tireless
from sim.path_tracking.randomization import Randomization
from sim.robot.parameters import RobotParameters
from trackslip import se2
from trackslip.kinematics import Array
from trackslip.trajectory.base import Reference

FACTORS: Final = ("controller", "compensation", "reference", "ground", "start", "seed")
"""Axes along which a benchmark's runs differ; each is a field of BenchmarkCase."""
_PAPER: Final = ("none", "published", "exponential", "icr_radius", "online")
_THREE: Final = ("none", "icr_radius", "online")
_GROUNDS: Final = ("stone", "ice", "sticky")
_UNSEEN: Final = tuple(name for name in REFERENCE_NAMES if name not in TRAINING_PATHS)
# forward, left, heading: Sec. IV-C, (0.3, -0.2, pi/3) from (0, 0, pi/2)
_PAPER_OFFSET: Final = (-0.2, -0.3, -np.pi / 6)
# limits for a random start
_MAX_OFFSET: Final = 0.15  # [m]
_MAX_ROTATION: Final = np.radians(20)  # [rad]


class Suite(NamedTuple):
    """Full factorial designs over FACTORS, and the suite's defaults for `--plants` and
    `--gains`.
    """

    plants: str
    gains: str
    designs: Sequence[Sequence[Sequence[Any]]]


_SECTION_4: Final = [
    (("feedforward",), _PAPER, ("paper",), ("stone",), ("zero",), range(5)),
    (("linear",), _PAPER, ("paper",), ("stone",), ("paper", "zero"), range(5)),
]
SUITES: Final = {
    "paper": Suite("nominal", "default", _SECTION_4),
    "fair": Suite(
        "drawn", "tuned", [(CONTROLLER_NAMES, _THREE, _UNSEEN, ("stone",), ("random",), range(8))]
    ),
    "full": Suite(
        "drawn",
        "tuned",
        [(CONTROLLER_NAMES, _THREE, REFERENCE_NAMES, _GROUNDS, ("random",), range(3))],
    ),
}
"""The suites by name."""


@dataclass(frozen=True)
class BenchmarkCase:
    """One run: the names of its controller, compensation, reference, ground and start, and its
    seed.
    """

    controller: str
    compensation: str
    reference: str
    ground: str
    start: str
    seed: int
    id: str = ""
    """Hash of everything that the run's numbers depend on, including the contents of files."""
    plan: PathPlan = PLAN
    """How the reference's file becomes a path."""

    @property
    def name(self) -> str:
        """Name of the run: the values of its factors, separated by spaces."""
        return " ".join(map(str, self.axes.values()))

    @property
    def axes(self) -> dict[str, Any]:
        """The values of the FACTORS, by name."""
        return {name: getattr(self, name) for name in FACTORS}

    @property
    def fleet(self) -> str:
        """Key for runs that are driven together: the reference."""
        return self.reference

    @property
    def path(self) -> Reference:
        """The reference."""
        return self.plan.path(self.reference)

    @property
    def duration(self) -> float:
        """Simulated time [s]."""
        return self.path.duration

    @property
    def key(self) -> str:
        """Key for random numbers, besides the seed: the reference's name, without its file's folder
        or ending.
        """
        return Path(self.reference).stem

    def start_pose(self) -> Array:
        """Start pose (3,) [m, m, rad]."""
        offset = np.zeros(3)
        if self.start == "paper":
            offset = np.array(_PAPER_OFFSET)
        elif self.start == "random":
            rng = generator(self.seed, f"start {self.key}")
            # evenly over a disc, as its area grows with the square of the distance
            distance = _MAX_OFFSET * np.sqrt(rng.uniform())
            bearing = rng.uniform(-np.pi, np.pi)
            rotation = rng.uniform(-_MAX_ROTATION, _MAX_ROTATION)
            offset = np.array([*(distance * se2.direction(bearing)), rotation])
        return se2.compose(self.path.pose(0.0), offset)


def planned_cases(config: Config, plan: PathPlan = PLAN) -> list[BenchmarkCase]:
    """All cases that the options describe, without duplicates; files become paths as in `plan`."""
    options = (
        config.controllers,
        config.compensations,
        config.references,
        config.grounds,
        config.starts,
        config.seeds,
    )
    cases: list[BenchmarkCase] = []
    for design in SUITES[config.suite].designs:
        values = [option or default for option, default in zip(options, design, strict=True)]
        cases += [
            replace(BenchmarkCase(*combination), plan=plan) for combination in product(*values)
        ]
    return list(dict.fromkeys(cases))


def plant_ranges(robot: RobotParameters) -> Randomization:
    """Ranges around a robot's parameters, from which a plant's properties are drawn uniformly and
    independently.

    Raises InvalidValueError for a robot so close to its limits that a drawn plant might not stand
    or be simulated.
    """
    nominal = robot.radius_error
    lag = or_tireless(robot.drive).lag
    shift = 0.1 * robot.half_gauge
    ranges = Randomization(
        friction_ratio=(0.8, 1.25),
        radius_error=(nominal - 0.03, nominal + 0.03),
        com_x=(-shift, shift),
        com_y=(-shift, shift),
        lag=(0.5 * lag, min(2.0 * lag, 1.0)),
        patches=(0, 2),
        patch_size=(0.3, 1.0),
        patch_friction=(0.5, 1.0),
    )
    ranges.require_standing(robot)
    return ranges
