"""What of the robot can be changed without another MJCF file."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from sim.drive import LARGEST_RADIUS_ERROR, RADIUS_ERROR
from trackslip.errors import InvalidValueError, require_at_most, require_positive
from trackslip.skid_theory import line_contact


@dataclass(frozen=True)
class RobotParameters:
    """Shape and weight of the robot. The defaults are those of models/tracked_robot.xml."""

    half_gauge: float = 0.168
    """Half the distance between the tracks [m]."""
    contact_length: float = 0.34
    """Length of track on the ground [m]."""
    sprocket_radius: float = 0.06
    """Nominal radius of the sprockets [m]."""
    radius_error: float = RADIUS_ERROR
    """Relative error of the effective sprocket radius, real / nominal - 1 [-]."""
    mass: float = 25.0
    """[kg]"""
    com_x: float = 0.0
    """Centre of mass, forward of the middle of the tracks [m]."""
    com_y: float = 0.0
    """Centre of mass, to the left of the middle [m]."""
    com_height: float = 0.12
    """Centre of mass above the ground [m]."""

    def __post_init__(self) -> None:
        for name in ("half_gauge", "contact_length", "sprocket_radius", "mass", "com_height"):
            require_positive(name, getattr(self, name))
            require_at_most(name, getattr(self, name), 1000.0 if name == "mass" else 10.0)
        if not -LARGEST_RADIUS_ERROR <= self.radius_error <= LARGEST_RADIUS_ERROR:
            raise InvalidValueError(
                "radius_error", self.radius_error, f"from {-LARGEST_RADIUS_ERROR:g} to {LARGEST_RADIUS_ERROR:g}"
            )
        for name, reach in (("com_x", self.contact_length / 6), ("com_y", self.half_gauge)):
            if not abs(getattr(self, name)) < reach:
                raise InvalidValueError(name, getattr(self, name), f"between -{reach:.4g} and {reach:.4g} m")
        # raises for a centre of mass that lifts part of a track
        line_contact(self.half_gauge, self.contact_length / 2, 1.0, 1.0, (self.com_x, self.com_y, self.com_height))

    def apply(self, spec: mujoco.MjSpec) -> None:
        """Change a model: move its tracks, stretch their contact, place the weight."""
        default = RobotParameters()
        if self == default:
            return
        stretch = self.contact_length / default.contact_length
        apart = self.half_gauge - default.half_gauge
        chassis = spec.body("chassis")
        for thing in (*chassis.geoms, *chassis.sites):
            side = {"left": 1.0, "right": -1.0}.get(thing.name.split("_")[0], 0.0)
            track = side != 0 and "lamp" not in thing.name
            if "_pad" in thing.name:
                ends = np.array(thing.fromto).reshape(2, 3)
                ends[:, 0] *= stretch
                ends[:, 1] += side * apart
                thing.fromto = ends.ravel()
            elif track:
                thing.pos = np.add(thing.pos, [0.0, side * apart, 0.0])
            if "_footprint" in thing.name:
                thing.size = np.array(thing.size) * [stretch, 1.0, 1.0]
        for name in ("left_sprocket", "right_sprocket"):
            spec.geom(name).size[0] = self.sprocket_radius
        chassis.ipos = [self.com_x, self.com_y, self.com_height]
        chassis.inertia = np.array(chassis.inertia) * (self.mass / chassis.mass)
        chassis.mass = self.mass
