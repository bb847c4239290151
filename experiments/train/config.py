"""The options of `trackslip train`."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar, Final, Literal

import tyro

from experiments.common.choices import (
    COMPENSATIONS,
    FTR_NAMES,
    REFERENCES,
    ROBOTS,
    TRAINING_PATHS,
    WITHOUT_LAWS,
)
from experiments.common.options import (
    Distinct,
    Excludes,
    Exclusion,
    Needs,
    Positive,
    ResultsOptions,
    Whole,
    default_is,
)
from experiments.simulate.options import MAX_THREADS
from trackslip.errors import require

EXAMPLES: Final = (
    ("two million steps", "trackslip train"),
    ("resume from the last checkpoint", "trackslip train --steps 4000000 --resume"),
    (
        "to cross courses",
        "trackslip train --env traverse --courses rails stairs_up --out out/rails",
    ),
    ("a quick try", "trackslip train --steps 100000 --robots 16 --batch 512 --out out/quick"),
)
ESSENTIAL: Final = (
    "env",
    "steps",
    "references",
    "grounds",
    "compensation",
    "robot",
    "courses",
    "resume",
    "out",
    "overwrite",
)
TRAVERSE: Final = "traverse"
_MAX_ROWS: Final = 4_000_000  # control periods between two updates, of about 300 bytes each
ENVIRONMENT: Final = (
    "env",
    "robots",
    "references",
    "grounds",
    "compensation",
    "authority",
    "robot",
    "laws",
    "courses",
    "difficulty",
    "own_rewards",
    "seed",
)
"""Options that determine the robots and their episodes; with --resume, the robots continue if none
of them has changed.
"""


@dataclass(frozen=True)
class Config(ResultsOptions):
    """Train a policy with PPO that corrects the reference's twist, for `benchmark --controllers
    ppo:OUT`.

    With --env traverse, train a policy that corrects the scripted controller of a robot that
    crosses courses. The defaults are the tuned configuration behind the documented results in path
    tracking.
    """

    env: Literal["path_tracking", "traverse"] = "path_tracking"
    """Environment: following paths, or crossing courses with a tracked robot with flippers."""
    steps: Annotated[int, Whole(1, 10**10)] = 2_000_000
    """Total number of control periods, summed over all robots."""
    robots: Annotated[int, Whole(1, 4096)] = 64
    """Number of robots in the vector environment."""
    references: Annotated[
        tuple[str, ...], Distinct(), tyro.conf.arg(metavar=f"{REFERENCES} ...")
    ] = TRAINING_PATHS
    """Paths to train on; each episode draws one."""
    grounds: Annotated[tuple[str, ...], Distinct(), tyro.conf.arg(metavar="GROUND ...")] = (
        "stone",
    )
    """Grounds to train on; each episode draws one."""
    compensation: Annotated[str, tyro.conf.arg(metavar=COMPENSATIONS)] = "icr_radius"
    """Slip compensation; online compensations start anew in each episode."""
    authority: Annotated[tuple[float, float], Positive(10.0)] = (0.12, 0.6)
    """Largest correction of the reference's speed and yaw rate, as shares of the actions' units,
    0.3 m/s and 1 rad/s [-].
    """
    robot: Annotated[str | None, default_is("shipped; with --env traverse, rescue", ROBOTS)] = None
    """Robot: a name, a parameter file as written by calibrate, or a model file (MJCF, URDF) with
    its tracks.
    """
    laws: Annotated[Path | None, default_is("the laws shipped with trackslip", "PATH")] = None
    """Identified laws of the robot for --compensation: a summary.json, or a folder that contains
    one.
    """
    courses: Annotated[
        tuple[str, ...], Distinct(), tyro.conf.arg(metavar="{random,steps_up,...} ...")
    ] = ("random",)
    """Courses, random or from FTR-Bench; each episode draws one of them; needs --env traverse."""
    difficulty: tuple[float, float] = (0.7, 1.0)
    """Range of the courses' difficulty, from 0 to 1; needs --env traverse [-]."""
    trials: Annotated[int, Whole(1, 10_000)] = 300
    """Number of unseen courses that test the policy, for each of three difficulties or each of
    several --courses.
    """
    own_rewards: Annotated[dict[str, float], default_is("none", "MODULE:NAME WEIGHT ...")] = field(
        default_factory=dict
    )
    """Your own reward terms, functions of the task, with weights; policies don't need them."""
    network: Annotated[tuple[int, ...], Whole(1, 4096)] = (64, 64)
    """Sizes of the hidden layers."""
    learning_rate: Annotated[float, Positive(1.0)] = 6e-4
    """Initial learning rate, which falls linearly to a twentieth [-]."""
    horizon: Annotated[int, Whole(1, 100_000)] = 128
    """Number of control periods per robot between two updates."""
    batch: Annotated[int, Whole(1)] = 2048
    """Number of control periods in a minibatch."""
    epochs: Annotated[int, Whole(1, 1000)] = 6
    """Number of passes over the collected data in each update."""
    discount: Annotated[float, Positive(1.0)] = 0.97
    """Discount factor for rewards per control period [-]."""
    seed: Annotated[int, Whole(0, 2**32 - 1)] = 0  # the largest seed of NumPy's legacy generators
    """Seed for all random numbers."""
    threads: Annotated[int, Whole(0, MAX_THREADS)] = 0
    """Number of the simulator's worker threads, 0 for one per processor."""
    resume: bool = False
    """Resume from the last checkpoint in OUT instead of starting again."""
    out: Path = Path("out/train")
    """Folder for the policy, its checkpoints and the report."""
    pdf: bool = False
    """Also write the figures as PDF."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Needs(("courses", "difficulty", "trials"), "env", (TRAVERSE,)),
        Excludes(
            ("references", "grounds", "compensation", "laws", "authority"), "env", (TRAVERSE,)
        ),
        Excludes(("laws",), "compensation", WITHOUT_LAWS),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        rows = self.robots * self.horizon
        most = f"at most {_MAX_ROWS // self.robots} for {self.robots} robots, to fit in memory"
        require(rows <= _MAX_ROWS, "horizon", self.horizon, most)
        is_factor = rows % self.batch == 0
        require(is_factor, "batch", self.batch, f"a factor of robots * horizon = {rows}")
        known = ("random", *FTR_NAMES)
        for course in self.courses:
            require(course in known, "courses", course, f"some of {', '.join(known)}")

    @property
    def runs_anew(self) -> bool:
        """Whether a training starts again or continues."""
        return self.overwrite or self.resume
