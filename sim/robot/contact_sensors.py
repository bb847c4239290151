"""Contact sensors at the pads, an addition to the model that `sim.instruments` reads."""

from __future__ import annotations

import mujoco

_FORCE, _POSITION, _VELOCITY = 1, 4, 7  # bits of a contact sensor's data specification
WIDTH = 9
"""Numbers per point, in this order: force, position in the world, velocity; force and velocity are normal to the
ground, along the pad and across it."""
POINTS = 2
"""Number of points at which a pad touches the ground."""


def add_contact_sensors(spec: mujoco.MjSpec) -> None:
    """Add a sensor of the contact with the ground to every pad of a model."""
    for geom in spec.geoms:
        if "_pad" in geom.name:
            spec.add_sensor(
                name=f"{geom.name}_contact",
                type=mujoco.mjtSensor.mjSENS_CONTACT,
                objtype=mujoco.mjtObj.mjOBJ_GEOM,
                objname="ground",
                reftype=mujoco.mjtObj.mjOBJ_GEOM,
                refname=geom.name,
                intprm=[1 << _FORCE | 1 << _POSITION | 1 << _VELOCITY, 0, POINTS],
            )
