"""Options of `trackslip drive`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from experiments.options.checks import refuse_unused, require_between, require_integer, require_positive_up_to
from experiments.options.help import default_is
from experiments.options.world import MAX_DURATION
from trackslip.errors import InvalidValueError, require_at_most, require_positive

MAX_PICTURES = 100
_MAX_SPEED, _MAX_TURN = 2.0, 5.0  # [m/s], [rad/s]
_MAX_ANGLE = 6.3  # of a flipper [rad]
_MAX_FRICTION = 5.0
FLIPPERS = ("up", "down", "reflex")
UP, DOWN = 1.2, 0.0
"""Angles of flippers that are up, and that lie along the tracks, positive is up [rad]."""


@dataclass(frozen=True)
class DriveConfig:
    """Drive a robot with tracks over a course, store the run with pictures, and print how it went."""

    robot: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = "rescue"
    """Robot: rescue, box, or a .toml file with your own model and its tracks."""
    course: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = "stairs"
    """Course: flat, ramp20, step10, stairs, cross_beams, pallets, rough, gap, side_slope, arena, or a .toml file."""
    speed: float = 0.3
    """Speed of the belts, negative to drive backwards [m/s]."""
    turn: float = 0.0
    """Commanded yaw rate, positive to the left; the robot turns less, as its tracks slip [rad/s]."""
    path: Annotated[Path | None, default_is("straight on", "FILE.csv")] = None
    """Way points x, y to follow by the true pose, in the course's frame [m]."""
    flippers: Annotated[str, tyro.conf.arg(metavar="{up,down,reflex,ANGLES}")] = "reflex"
    """Flippers: up, down (along the tracks), by reflex, or angles: one, front,rear, or one each, tips up [rad]."""
    preset: Literal["accurate", "fast"] = "accurate"
    """Contact of the tracks: steps of 2 ms, or of 4 ms."""
    friction: Annotated[float | None, default_is("the course's", "FLOAT")] = None
    """Friction coefficient between tracks and course [-]."""
    duration: float = 60.0
    """Longest run [s]."""
    seed: Annotated[int | None, default_is("the course's", "INT")] = None
    """Seed of what is random about the course."""
    teleop: bool = False
    """Drive it yourself, in MuJoCo's viewer with the arrow keys; needs a display."""
    video: Annotated[Path | None, default_is("none", "FILE.mp4")] = None
    """Also write a video; needs pip install "trackslip[video]"."""
    pictures: int = 0
    """Number of pictures to write to OUT/pictures, evenly over the run."""
    out: Path = Path("out/drive")
    """Folder for the results."""

    def __post_init__(self) -> None:
        require_between("speed", self.speed, -_MAX_SPEED, _MAX_SPEED, "m/s")
        require_between("turn", self.turn, -_MAX_TURN, _MAX_TURN, "rad/s")
        require_positive("duration", self.duration)
        require_at_most("duration", self.duration, MAX_DURATION, "s")
        require_positive_up_to("friction", self.friction, _MAX_FRICTION)
        require_integer("pictures", self.pictures, 0, MAX_PICTURES)
        if self.seed is not None:
            require_integer("seed", self.seed)
        if self.video is not None and self.video.suffix.lower() != ".mp4":
            raise InvalidValueError("video", str(self.video), "a file that ends in .mp4")
        self.flipper_angles()
        if self.path is not None:
            refuse_unused(self, ("turn",), "with --path")
            require_positive("speed", self.speed)
        if self.teleop:
            refuse_unused(self, ("path", "turn"), "with --teleop")

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
