"""Tracked robots: a model, its tracks or wheels, and its flippers."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sim.motors.motor import Drive
from sim.robot.parameters import PATCH_LENGTH, TRACKS, WHEELS
from sim.robot.urdf import read_model
from sim.tracks import Track
from sim.tracks.hull import Hull
from trackslip.errors import Checked, checked, require, require_non_negative, require_positive

Wheels = tuple[tuple[float, float, float], ...]

_LEVEL = -0.9998  # largest upward component of the normal of a level run: 1.1 degrees off level [-]
_SAME_HEIGHT = 0.005  # largest height difference between wheels that stand on level ground [m]


def _width(width: float, lines: int) -> float:
    """Width of a belt on the ground [m]."""
    require(lines in (1, 3), "lines", lines, "1 or 3")
    return width if lines == 3 else 0.0


@dataclass(frozen=True)
class Flipper(Checked):
    """A hinged body with one track, which runs together with the chassis' track on the same
    side.
    """

    body: str
    """Name of the body."""
    side: str
    """Side of the chassis, left or right, whose track drives the flipper's belt."""
    hull: Wheels
    """Wheels (x, z, radius) in the body's frame [m]; the belt is their convex hull."""
    y: float = 0.0
    """Lateral position of the track in the body's frame [m]."""
    width: float = checked(0.05, require_positive)
    """Width of the belt [m]."""
    stiffness: float = checked(250.0, require_positive)
    """Stiffness of the motor that a hinge without a motor gets [N m/rad]."""
    damping: float = checked(15.0, require_non_negative)
    """Damping of the added motor [N m s/rad]."""
    torque: float = checked(90.0, require_positive)
    """Largest torque of the added motor, unless the model limits the hinge's torque [N m]."""
    lines: int = 1
    """Lines of contact across the belt's width, 1 or 3; with 1 line, the width is only drawn."""

    def __post_init__(self) -> None:
        Hull.from_wheels(self.hull)
        require(self.side in ("left", "right"), "side", self.side, "left or right")
        require(abs(self.y) <= 10, "y", self.y, "from -10 to 10 m")
        super().__post_init__()

    def track(self, preset: str, friction: tuple[float, float]) -> Track:
        """The flipper's track, with this contact preset and friction along and across it [-]."""
        name, width = f"{self.body}_track", _width(self.width, self.lines)
        return Track(self.y, self.hull, preset, friction, name, side="left", width=width)


@dataclass(frozen=True)
class TrackedRobot:
    """A model and its tracks or wheels; a robot file has these fields, and a table `flippers` for
    each flipper.
    """

    model: Path
    """MJCF or URDF file; in a robot file, its path is relative to the robot file."""
    half_gauge: float
    """Half the distance between the chassis' tracks [m]."""
    hull: Wheels
    """Wheels (x, z, radius) on one side of the chassis, in its frame [m]; the belt is their convex
    hull.
    """
    body: str = ""
    """Name of the chassis; by default the only body directly in the model's world."""
    contact: str = TRACKS
    """What touches the ground: "tracks", or "wheels" that turn at one speed per side."""
    patch_length: float = PATCH_LENGTH
    """Length of a wheel's contact with level ground [m]."""
    width: float = 0.08
    """Width of the chassis' belts or tyres [m]."""
    lines: int = 1
    """Lines of contact across that width: 1 if the width is only drawn, or 3 to resist tipping over
    the edges.
    """
    flippers: tuple[Flipper, ...] = ()
    """Flippers, in any order."""
    wheels: tuple[str, ...] = ()
    """Links that tracks replace: they don't collide, and their joints are locked, except those of
    flippers. In a robot file, "replace" stands for the flippers and all round links that turn
    endlessly about y. `half_gauge` and `hull` are read from these wheels unless they are given.
    """
    packages: tuple[Path, ...] = ()
    """Folders of the packages in package://NAME/FILE, or their parent folders, searched before the
    folders above the model; other files of the model may lie in them, too. In a robot file, their
    paths are relative to the robot file.
    """
    key: str = field(default="", metadata={"stored_unless": ""})
    """MJCF keyframe from which joints and motors start; by default they start at 0."""
    name: str = "robot"
    """Name of the robot; by default the robot file's name without .toml."""
    drive: Drive | None = field(default=None, metadata={"stored_unless": None})
    """Servos and motors; None for motors of unlimited torque."""

    def __post_init__(self) -> None:
        require_positive("half_gauge", self.half_gauge)
        require_positive("width", self.width)
        Hull.from_wheels(self.hull)
        self.track("accurate", (1.0, 1.0))
        bodies = self.flipper_bodies
        require(
            len(set(bodies)) == len(bodies), "flippers", bodies, "on bodies that are all different"
        )

    def track(self, preset: str, friction: tuple[float, float]) -> Track:
        """The chassis' pair of tracks or rows of wheels, with this contact preset and friction
        along and across [-].
        """
        width, contact, patch = _width(self.width, self.lines), self.contact, self.patch_length
        return Track(
            self.half_gauge,
            self._level,
            preset,
            friction,
            width=width,
            contact=contact,
            patch_length=patch,
        )

    @property
    def flipper_bodies(self) -> tuple[str, ...]:
        """Names of the flippers' bodies, whose hinges aren't locked."""
        return tuple(flipper.body for flipper in self.flippers)

    @property
    def contact_length(self) -> float:
        """Length of the contact with level ground, from rear to front [m]."""
        patch = self.patch_length if self.contact == WHEELS else 0.0
        return max(self.standing) - min(self.standing) + patch

    @property
    def middle(self) -> float:
        """Middle of the contact with level ground, ahead of the chassis' frame [m]."""
        ends = self.standing
        return float(np.mean(ends if self.contact == WHEELS else [min(ends), max(ends)]))

    @property
    def standing(self) -> list[float]:
        """Axles of the wheels, or ends of the runs, that stand on level ground, ahead of the
        chassis' frame [m].
        """
        if self.contact == WHEELS:
            return [x for x, z, radius in self._level if z - radius < self.lowest + _SAME_HEIGHT]
        level = [run for run in Hull.from_wheels(self._level).runs if run.outwards[1] < _LEVEL]
        return [float(end[0]) for run in level for end in (run.start, run.end)] or [0.0]

    @property
    def _level(self) -> Wheels:
        """`hull` with its lowest wheels at the same height, to which tyres and springs would bring
        them.
        """
        highest = self.lowest + _SAME_HEIGHT
        return tuple((x, self.lowest + r if z - r < highest else z, r) for x, z, r in self.hull)

    @property
    def sprocket_radius(self) -> float:
        """Radius of the largest wheel, which is assumed to be the sprocket [m]."""
        return max(radius for _, _, radius in self.hull)

    @property
    def lowest(self) -> float:
        """Height of the lowest point of the chassis' tracks in the chassis' frame [m]."""
        return min(z - r for _, z, r in self.hull)

    def spec(self) -> Any:
        """The model as a `mujoco.MjSpec`; raises what `read_model` raises."""
        return read_model(self.model, self.wheels, self.packages)
