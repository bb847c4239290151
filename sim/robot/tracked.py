"""Tracked robots described by TOML files: a model, its tracks and its flippers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import models
from sim.toml_file import build, read_named
from sim.tracks.hull import Hull
from trackslip.errors import require, require_non_negative, require_positive

Wheels = tuple[tuple[float, float, float], ...]

_FOLDER = Path(models.__file__).parent
TRACKED_ROBOTS = {"rescue": _FOLDER / "rescue_robot.toml", "box": _FOLDER / "box_robot.toml"}
"""Robot files by the names of their robots."""
_WIDTH = 0.08  # [m]


@dataclass(frozen=True)
class Flipper:
    """A hinged body with one track, which is driven together with the chassis' track on its side."""

    body: str
    """Name of the body."""
    side: str
    """Side of the chassis' track that drives its belt, left or right."""
    hull: Wheels
    """Wheels (x, z, radius) in the body's frame, in the order of the belt [m]."""
    y: float = 0.0
    """Lateral place of the track in the body's frame [m]."""
    width: float = 0.05
    """Drawn width of the belt [m]."""
    stiffness: float = 250.0
    """Stiffness of the motor added to a hinge without one [N m/rad]."""
    damping: float = 15.0
    """Damping of that motor [N m s/rad]."""
    torque: float = 90.0
    """Largest torque of that motor, unless the model limits the hinge's [N m]."""

    def __post_init__(self) -> None:
        Hull.from_wheels(self.hull)
        require(self.side in ("left", "right"), "side", self.side, "left or right")
        require(abs(self.y) <= 10, "y", self.y, "from -10 to 10 m")
        for name in ("width", "stiffness", "torque"):
            require_positive(name, getattr(self, name))
        require_non_negative("damping", self.damping)


@dataclass(frozen=True)
class TrackedRobot:
    """A model and its tracks; a robot file has these fields, and a table `flippers` for each of them."""

    model: Path
    """MJCF or URDF file; in a robot file relative to that file."""
    half_gauge: float
    """Half the distance between the chassis' tracks [m]."""
    hull: Wheels
    """Wheels (x, z, radius) of the chassis' tracks in its frame, in the order of the belt [m]."""
    body: str = ""
    """Name of the chassis; by default the model's only body that lies in the world itself."""
    width: float = _WIDTH
    """Drawn width of the chassis' belts [m]."""
    flippers: tuple[Flipper, ...] = ()
    """Flippers, in any order."""
    name: str = "robot"
    """Name of the robot: its robot file's without .toml."""

    def __post_init__(self) -> None:
        Hull.from_wheels(self.hull)
        require_positive("half_gauge", self.half_gauge)
        require_positive("width", self.width)
        bodies = [flipper.body for flipper in self.flippers]
        require(len(set(bodies)) == len(bodies), "flippers", bodies, "on bodies that are all different")

    @property
    def contact_length(self) -> float:
        """Distance between the first and the last wheel that stand on level ground [m]."""
        low = min(z - r for _, z, r in self.hull)
        standing = [x for x, z, r in self.hull if z - r < low + 1e-3]
        return max(standing) - min(standing)

    @property
    def lowest(self) -> float:
        """Height of the lowest point of the chassis' tracks in its frame [m]."""
        return min(z - r for _, z, r in self.hull)


def load_tracked(source: str | Path = "rescue") -> TrackedRobot:
    """The robot of that name (`TRACKED_ROBOTS`), or of a robot file.

    Raises:
        InvalidValueError: for an unknown name that is no file.
        SettingsFileError: for a file that can't be read, unknown or missing fields and values that aren't allowed.
    """
    path = Path(TRACKED_ROBOTS.get(str(source), source))
    allowed = f"one of {', '.join(TRACKED_ROBOTS)}, or a .toml file that names the model and gives its tracks"
    require(path.suffix.lower() == ".toml", "robot", str(source), allowed)
    table = {"name": path.stem.removesuffix("_robot"), **read_named("robot", str(path), TRACKED_ROBOTS)}
    robot = build(TrackedRobot, table, str(path))
    return replace(robot, model=path.parent / robot.model)
