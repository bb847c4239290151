"""The options of `trackslip drive`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import tyro

from experiments.common.choices import FTR_NAMES
from experiments.common.options import Excludes, Exclusion, Positive, ResultsOptions, Whole, Within, default_is
from experiments.simulate.options import MAX_DURATION, RobotSource
from trackslip.errors import InvalidValueError, require_positive

EXAMPLES = (
    ("the rescue robot on stairs, flippers by reflex", "trackslip drive"),
    ("slowly over a step, with pictures", "trackslip drive --course step10 --speed 0.1 --pictures 8"),
    ("your own robot and course, as a video", "trackslip drive --robot r.toml --course c.toml --video drive.mp4"),
    ("over a rail as in FTR-Bench, scaled to the robot", "trackslip drive --course rails --difficulty 0.8"),
    ("by the keyboard", "trackslip drive --course arena --teleop"),
)


MAX_PICTURES = 100
_MAX_SPEED, _MAX_TURN = 2.0, 5.0  # [m/s], [rad/s]
_MAX_ANGLE = 6.3  # of a flipper [rad]
_MAX_FRICTION = 5.0
FLIPPERS = ("up", "down", "reflex")
UP, DOWN = 1.2, 0.0
"""Angles of flippers that are up, and that lie along the tracks, positive is up [rad]."""


@dataclass(frozen=True)
class Config(ResultsOptions):
    """Drive a robot with tracks over a course, store the run with pictures, and print how it went."""

    robot: RobotSource = "rescue"
    """Robot: a name, a file of a model (MJCF, URDF) with its tracks, or of parameters as written by calibrate."""
    course: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = "stairs"
    """Course: flat, ramp20, step10, stairs, cross_beams, pallets, rough, gap, side_slope, arena, FTR-Bench's, FILE."""
    difficulty: Annotated[float, Within(0.0, 1.0)] = 0.5
    """Difficulty of a course of FTR-Bench, from the smallest published sizes to the largest [-]."""
    speed: Annotated[float, Within(-_MAX_SPEED, _MAX_SPEED, "m/s")] = 0.3
    """Speed of the belts, negative to drive backwards [m/s]."""
    turn: Annotated[float, Within(-_MAX_TURN, _MAX_TURN, "rad/s")] = 0.0
    """Commanded yaw rate, positive to the left; the robot turns less, as its tracks slip [rad/s]."""
    path: Annotated[Path | None, default_is("straight on", "FILE.csv")] = None
    """Waypoints x, y to follow by the true pose, in the course's frame [m]."""
    flippers: Annotated[str, tyro.conf.arg(metavar="{up,down,reflex,ANGLES}")] = "reflex"
    """Flippers: up, down (along the tracks), by reflex, or angles: one, FRONT,REAR, or one each, tips up [rad]."""
    preset: Literal["accurate", "fast"] = "accurate"
    """Contact of the tracks: steps of 2 ms, or of 4 ms."""
    friction: Annotated[float | None, Positive(_MAX_FRICTION), default_is("the course's", "FLOAT")] = None
    """Friction coefficient between tracks and course [-]."""
    duration: Annotated[float, Positive(MAX_DURATION, "s")] = 60.0
    """Longest run [s]."""
    seed: Annotated[int | None, Whole(), default_is("the course's", "INT")] = None
    """Seed of the course's random parts."""
    teleop: bool = False
    """Drive it yourself, in MuJoCo's viewer with the arrow keys; needs a display."""
    video: Annotated[Path | None, default_is("none", "FILE.mp4")] = None
    """Also write a video; needs pip install "trackslip[video]"."""
    pictures: Annotated[int, Whole(0, MAX_PICTURES)] = 0
    """Number of pictures to write to OUT/pictures, evenly over the run."""
    out: Path = Path("out/drive")
    """Folder for the results."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (Excludes(("turn",), "path"), Excludes(("path", "turn"), "teleop"))

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.video is not None and self.video.suffix.lower() != ".mp4":
            raise InvalidValueError("video", str(self.video), "a file that ends in .mp4")
        self.flipper_angles()
        if self.course not in FTR_NAMES and self.difficulty != Config.difficulty:
            raise InvalidValueError("difficulty", self.difficulty, "left out without a course of FTR-Bench")
        if self.path is not None:
            require_positive("speed", self.speed)

    def flipper_angles(self) -> tuple[float, ...] | None:
        """Angles of the flippers, one for all of them or more; None by reflex [rad]."""
        if self.flippers in FLIPPERS:
            return {"up": (UP,), "down": (DOWN,)}.get(self.flippers)
        allowed = f"{', '.join(FLIPPERS)}, or angles up to {_MAX_ANGLE:g} rad, separated by commas"
        try:
            angles = tuple(float(part) for part in self.flippers.split(","))
        except ValueError:
            raise InvalidValueError("flippers", self.flippers, allowed) from None
        if not all(abs(angle) <= _MAX_ANGLE for angle in angles):
            raise InvalidValueError("flippers", self.flippers, allowed)
        return angles
