"""Contact sensors of the pads: an addition to the model that `sim.instruments` reads."""

from __future__ import annotations

import mujoco

_FORCE, _POSITION, _VELOCITY = 1, 4, 7  # bits of a contact sensor's data specification
WIDTH = 9
"""Numbers for a point: force, velocity (normal, along the pad, across it) around its position in the world."""
POINTS = 2
"""Points at which a pad touches the ground."""


def add_contact_sensors(spec: mujoco.MjSpec) -> None:
    """Give every pad of a model a sensor of its contact with the ground."""
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
