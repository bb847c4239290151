"""Tracked robots: a model, its tracks and its flippers."""

from __future__ import annotations

import os.path
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco

from sim.tracks.hull import Hull
from trackslip.errors import TrackslipError, require, require_non_negative, require_positive

Wheels = tuple[tuple[float, float, float], ...]

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
    """Width of the belt [m]."""
    stiffness: float = 250.0
    """Stiffness of the motor added to a hinge without one [N m/rad]."""
    damping: float = 15.0
    """Damping of that motor [N m s/rad]."""
    torque: float = 90.0
    """Largest torque of that motor, unless the model limits the hinge's [N m]."""
    lines: int = 1
    """Lines of contact across the belt's width, which is only drawn with one line."""

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
    """Width of the chassis' belts [m]."""
    lines: int = 1
    """Lines of contact across that width, which is only drawn with one line; three resist tipping over its edges."""
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
        return max(self._standing) - min(self._standing)

    @property
    def middle(self) -> float:
        """Middle between these wheels, ahead of the chassis' frame [m]."""
        return (max(self._standing) + min(self._standing)) / 2

    @property
    def _standing(self) -> list[float]:
        return [x for x, z, r in self.hull if z - r < self.lowest + 1e-3]

    @property
    def sprocket_radius(self) -> float:
        """Radius of the largest wheel, which is taken for the sprocket [m]."""
        return max(radius for _, _, radius in self.hull)

    @property
    def lowest(self) -> float:
        """Height of the lowest point of the chassis' tracks in its frame [m]."""
        return min(z - r for _, z, r in self.hull)

    def spec(self) -> Any:
        """The model as a `mujoco.MjSpec`; raises TrackslipError where there is no such file."""
        if not os.path.isfile(self.model):  # Path.is_file fails for long names
            raise TrackslipError(f"{self.model}: no such file; `model` must name the robot's MJCF or URDF file")
        return mujoco.MjSpec.from_file(str(self.model))
