"""Robot parameters that can be changed without editing the MJCF file, and their TOML files."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from sim.drive.drive import MAX_RADIUS_ERROR, RADIUS_ERROR
from sim.ground.ground import Ground
from sim.robot.pads import lay_pads, points_per_track
from sim.width import warn_if_unverified
from trackslip.errors import require, require_at_most, require_finite, require_positive, require_within
from trackslip.kinematics import RobotGeometry

if TYPE_CHECKING:
    import mujoco

BELT_LOOKS = tuple(f"{side}_{part}" for side in ("left", "right") for part in ("belt", "wheels", "sprocket"))
"""Geoms that are the looks of the shipped robot's tracks."""
SINK = 0.002
"""Sinkage of the tracks into level ground under the robot's weight, set by the contact recipe for any robot [m]."""
_MIN_SIZE = 1e-3  # length [m] and mass [kg]
_MAX_MASS = 1e5  # [kg]
_PLATE_HEIGHT = 0.5  # of models/tracked_robot.xml [m]
_FIRM = 0.25  # largest part of the ground's righting moment that the weight of a leaning robot may cancel


@dataclass(frozen=True)
class RobotParameters:
    """Shape and mass of the robot. The defaults equal models/tracked_robot.xml."""

    half_gauge: float = 0.168
    """Half the distance between the tracks [m]."""
    contact_length: float = 0.34
    """Length of the tracks' contact with the ground [m]."""
    sprocket_radius: float = 0.06
    """Nominal radius of the sprockets [m]."""
    radius_error: float = RADIUS_ERROR
    """Relative error of the effective sprocket radius, real / nominal - 1 [-]."""
    mass: float = 25.0
    """Mass of the robot [kg]."""
    com_x: float = 0.0
    """Centre of mass, forward of the centre of the tracks [m]."""
    com_y: float = 0.0
    """Centre of mass, to the left of the centre of the tracks [m]."""
    com_height: float = 0.12
    """Centre of mass above the ground [m]."""
    inertia: tuple[float, ...] = field(default=(), metadata={"stored_unless": ()})
    """Inertia about the centre of mass, xx, yy, zz, xy, xz, yz; empty to scale the shipped robot's with mass and shape
    [kg m^2]."""
    plate_height: float = field(default=_PLATE_HEIGHT, metadata={"stored_unless": _PLATE_HEIGHT})
    """Height of the plate's centre, and of the scanner, above the ground [m]."""
    looks: str = field(default="", metadata={"stored_unless": ""})
    """Name or file of the tracked robot that is drawn; empty for the shipped robot's looks."""

    def __post_init__(self) -> None:
        for name in ("half_gauge", "contact_length", "sprocket_radius", "mass", "com_height", "plate_height"):
            value, unit = getattr(self, name), "kg" if name == "mass" else "m"
            require_positive(name, value)
            require_at_most(name, value, _MAX_MASS if name == "mass" else 10.0, unit)
            require(value >= _MIN_SIZE, name, value, f"at least {_MIN_SIZE:g} {unit}")
        if self.inertia:
            require_inertia(self.inertia)
        require_within("radius_error", self.radius_error, -MAX_RADIUS_ERROR, MAX_RADIUS_ERROR)
        for name in ("com_x", "com_y"):
            require_finite(name, getattr(self, name))
        self._require_standing()
        warn_if_unverified(self.half_gauge, self.contact_length, level=3)

    @property
    def geometry(self) -> RobotGeometry:
        """Half gauge and nominal sprocket radius, for the kinematics."""
        return RobotGeometry(self.half_gauge, self.sprocket_radius)

    @property
    def centre_of_mass(self) -> tuple[float, float, float]:
        """Centre of mass, ahead and to the left of the middle of the tracks, and above the ground [m]."""
        return self.com_x, self.com_y, self.com_height

    def _require_standing(self) -> None:
        """Raise InvalidValueError if the centre of mass is so high, or so far off centre, that a track lifts off."""
        # mean squares of the coordinates of the ground's springs; they yield by SINK, so that a high robot leans more
        spread_x, spread_y = self.contact_length**2 / 12, self.half_gauge**2
        highest = _FIRM * min(spread_x, spread_y) / SINK
        allowed = f"at most {highest:.4g} m, to stand on tracks of this length and gauge"
        require(self.com_height <= highest, "com_height", self.com_height, allowed)
        reach_x = self.contact_length / 6 * (1 - self.com_height * SINK / spread_x)
        reach_y = self.half_gauge * (1 - self.com_height * SINK / spread_y)
        for name, com, reach in (("com_x", self.com_x, reach_x), ("com_y", self.com_y, reach_y)):
            require(abs(com) < reach, name, com, f"between -{reach:.4g} and {reach:.4g} m")
        central = abs(self.com_x) / reach_x + abs(self.com_y) / reach_y < 1
        allowed = "closer to the centre, to load every point of the tracks"
        require(central, "com_x, com_y", (self.com_x, self.com_y), allowed)

    def apply(self, spec: mujoco.MjSpec) -> None:
        """Apply the parameters to a model: move the tracks, stretch their contact, set mass, inertia and its centre."""
        default = RobotParameters()
        if self == default:
            return
        stretch = self.contact_length / default.contact_length
        chassis = spec.body("chassis")
        for thing in (*chassis.geoms, *chassis.sites):
            side = {"left": 1.0, "right": -1.0}.get(thing.name.split("_")[0], 0.0)
            outwards = side * (self.half_gauge - default.half_gauge)
            if "_pad" in thing.name:
                ends = np.array(thing.fromto).reshape(2, 3)
                thing.fromto = (ends * [stretch, 1.0, 1.0] + [0.0, outwards, 0.0]).ravel()
            elif "lamp" not in thing.name:
                thing.pos = np.add(thing.pos, [0.0, outwards, 0.0])
            if "_footprint" in thing.name:
                thing.size = np.array(thing.size) * [stretch, 1.0, 1.0]
        for name in ("left_sprocket", "right_sprocket"):
            spec.geom(name).size[0] = self.sprocket_radius
        points = points_per_track(self.half_gauge, self.contact_length)
        if points > points_per_track(default.half_gauge, default.contact_length):
            lay_pads(spec, points)
        raised = [0.0, 0.0, self.plate_height - default.plate_height]
        mast = spec.geom("mast")
        mast.pos = np.add(mast.pos, np.divide(raised, 2))
        mast.size[1] += max(raised[2] / 2, -0.1)
        spec.geom("plate").pos = np.add(spec.geom("plate").pos, raised)
        if lrf := spec.body("lrf"):  # in the model of the field
            lrf.pos = np.add(lrf.pos, raised)
        chassis.ipos = [self.com_x, self.com_y, self.com_height]
        # the mass distribution scales with the shape: its second moments with the squares of length, gauge and height
        growth = np.array([stretch, self.half_gauge / default.half_gauge, self.com_height / default.com_height]) ** 2
        inertia = np.array(chassis.inertia) * (self.mass / chassis.mass)
        moments = (inertia.sum() / 2 - inertia) * growth
        chassis.inertia = moments.sum() - moments
        chassis.mass = self.mass
        if self.inertia:
            chassis.inertia, chassis.fullinertia = [0.0, 0.0, 0.0], self.inertia


def require_inertia(inertia: Sequence[float]) -> None:
    """Raise InvalidValueError unless six numbers xx, yy, zz, xy, xz, yz are a rigid body's inertia [kg m^2]."""
    allowed = "six finite numbers xx, yy, zz, xy, xz, yz, as a rigid body has them [kg m^2]"
    require(len(inertia) == 6 and bool(np.isfinite(inertia).all()), "inertia", list(inertia), allowed)
    xx, yy, zz, xy, xz, yz = inertia
    moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    require(moments[0] > 0 and moments[2] <= moments[:2].sum() * (1 + 1e-9), "inertia", list(inertia), allowed)


def robot_file_text(parameters: RobotParameters, ground: Ground, comment: str) -> str:
    """Text of a robot file; `ground` must be level, without patches and changes."""
    shear = f"shear = {ground.shear!r}\n" if ground.shear > 0 else ""
    given = {name: value for name, value in dataclasses.asdict(parameters).items() if value not in ((), "")}
    lines = [f"{name} = {list(value) if name == 'inertia' else value!r}\n" for name, value in given.items()]
    return f"# {comment}\n{''.join(lines)}\n[ground]\nalong = {ground.along!r}\nacross = {ground.across!r}\n{shear}"
