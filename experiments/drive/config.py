"""The options of `trackslip drive`."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Final, Literal

import tyro

from experiments.common.choices import FTR_NAMES
from experiments.common.options import (
    Excludes,
    Exclusion,
    Positive,
    ResultsOptions,
    Whole,
    Within,
    default_is,
)
from experiments.simulate.options import MAX_DURATION, RobotSource, UsualSpeed
from trackslip.errors import require, require_positive

EXAMPLES: Final = (
    ("the rescue robot on stairs, flippers by reflex", "trackslip drive"),
    (
        "slowly over a step, with pictures",
        "trackslip drive --course step10 --speed 0.1 --pictures 8 --out out/step10",
    ),
    ("your own robot and course", "trackslip drive --robot r.toml --course c.toml --out out/own"),
    (
        "over a rail as in FTR-Bench, scaled to the robot",
        "trackslip drive --course rails --difficulty 0.8 --out out/rails",
    ),
    (
        "by a trained policy",
        "trackslip drive --course steps_up --policy out/train --out out/steps_up",
    ),
)
ESSENTIAL: Final = (
    "robot",
    "course",
    "speed",
    "turn",
    "path",
    "flippers",
    "duration",
    "policy",
    "pictures",
    "check",
    "out",
    "overwrite",
)

FLIPPERS: Final = {"up": (1.2, 1.2), "down": (0.0, 0.0), "reflex": None}
"""Front and rear flipper angles by name: up, along the tracks, or None for reflex [rad]."""


@dataclass(frozen=True)
class Config(ResultsOptions):
    """Drive a robot with tracks over a course, store the run with pictures, and print how it
    went.
    """

    robot: RobotSource = "rescue"
    """Robot: a name, a model file (MJCF, URDF) with its tracks, or a parameter file as written by
    calibrate.
    """
    course: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = "stairs"
    """Course: flat, ramp20, step10, stairs, cross_beams, pallets, rough, gap, side_slope, arena,
    FTR-Bench's, FILE.
    """
    difficulty: Annotated[float, Within(0.0, 1.0)] = 0.5
    """Difficulty of an FTR-Bench course, from the smallest published sizes to the largest [-]."""
    speed: Annotated[UsualSpeed, Within(-10.0, 10.0, "m/s")] = None
    """Speed of the belts, up to the robot's top speed; negative to drive backwards [m/s]."""
    turn: Annotated[float, Within(-5.0, 5.0, "rad/s")] = 0.0
    """Commanded yaw rate, positive to the left; the robot turns more slowly because its tracks slip
    [rad/s].
    """
    path: Annotated[Path | None, default_is("straight on", "FILE.csv")] = None
    """File of waypoints x, y in the course's frame, which are followed using the true pose [m]."""
    flippers: Annotated[str, tyro.conf.arg(metavar="{up,down,reflex}|FRONT,REAR")] = "reflex"
    """Flippers: up, down (along the tracks), reflex, or front and rear angles, positive with the
    tips up [rad].
    """
    preset: Literal["accurate", "fast"] = "accurate"
    """Track contact: steps of 2 ms (accurate) or 4 ms (fast)."""
    friction: Annotated[float | None, Positive(5.0), default_is("the course's", "FLOAT")] = None
    """Friction coefficient between tracks and course [-]."""
    duration: Annotated[float, Positive(MAX_DURATION, "s")] = 60.0
    """Time limit for the run [s]."""
    seed: Annotated[int | None, Whole(), default_is("the course's", "INT")] = None
    """Seed for the course's random parts."""
    policy: Annotated[Path | None, default_is("none", "FILE")] = None
    """Policy from train --env traverse that drives the robot: its .npz file, or the folder with
    that file.
    """
    pictures: Annotated[int | None, Whole(0, 1000), default_is("3 where OpenGL works", "INT")] = (
        None
    )
    """Number of pictures to write to OUT/pictures, spread evenly over the run."""
    check: bool = False
    """Print the robot's properties and all errors in its description, instead of driving."""
    out: Path = Path("out/drive")
    """Folder for the results."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Excludes(("turn",), "path"),
        Excludes(("path", "turn", "speed", "flippers"), "policy"),
        Excludes(
            (
                *("course", "difficulty", "speed", "turn", "path", "flippers", "preset"),
                *("friction", "duration", "seed", "policy", "pictures", "out", "overwrite"),
            ),
            "check",
        ),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        has_difficulty = self.course in FTR_NAMES or self.difficulty == Config.difficulty
        require(
            has_difficulty, "difficulty", self.difficulty, "left out without a course of FTR-Bench"
        )
        if self.path is not None and self.speed is not None:
            require_positive("speed", self.speed)
        self.flipper_angles()

    @property
    def stores_results(self) -> bool:
        """Whether the robot drives, and isn't only checked."""
        return not self.check

    def flipper_angles(self) -> tuple[float, float] | None:
        """Front and rear flipper angles, positive with the tips up [rad]; None for reflex."""
        if self.flippers in FLIPPERS:
            return FLIPPERS[self.flippers]
        try:
            front, rear = map(float, self.flippers.split(","))
        except ValueError:
            front = rear = math.nan
        is_allowed = abs(front) <= math.tau and abs(rear) <= math.tau
        require(
            is_allowed,
            "flippers",
            self.flippers,
            "up, down, reflex, or angles FRONT,REAR within a turn [rad]",
        )
        return front, rear
