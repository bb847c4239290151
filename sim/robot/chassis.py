"""The shipped robot's body in the size, with the mass, that parameters describe: everything but what touches."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

import models
from sim.robot.parameters import RobotParameters

MODELS = Path(models.__file__).parent
"""Folder of the shipped models."""
BODY_LOOKS = ("hull", "deck", "bumper", "left_lamp", "right_lamp")
"""Geoms that are the looks of the body."""
_TRACK_LOOKS = ("track0", "track1")


def shaped_robot(parameters: RobotParameters, file: str = "field.xml") -> Any:
    """The spec of a shipped model with the body of these parameters, and without the looks of its tracks."""
    spec = mujoco.MjSpec.from_file(str(MODELS / file))
    for name in _TRACK_LOOKS:
        spec.delete(spec.body(name))
    shipped, chassis = RobotParameters(), spec.body("chassis")
    size = np.array([parameters.contact_length, parameters.half_gauge, parameters.half_gauge])
    size /= [shipped.contact_length, shipped.half_gauge, shipped.half_gauge]
    spec.mesh("hull").scale = size
    for name in BODY_LOOKS:
        geom = spec.geom(name)
        geom.pos, geom.size = geom.pos * size, geom.size * size
    raised = np.array([0.0, 0.0, parameters.plate_height - shipped.plate_height])
    mast, plate = spec.geom("mast"), spec.geom("plate")
    mast.pos, plate.pos = mast.pos + raised / 2, plate.pos + raised
    mast.size[1] += max(raised[2] / 2, -0.1)
    if lrf := spec.body("lrf"):  # in the model of the field
        lrf.pos = lrf.pos + raised
    for site in (site for site in chassis.sites if "_footprint" in site.name):
        site.pos[1] = np.copysign(parameters.half_gauge, site.pos[1])
        site.size[0] = parameters.contact_length  # on either side of the middle: enough for any points
    _set_mass(chassis, parameters, np.array([size[0], size[1], parameters.com_height / shipped.com_height]))
    return spec


def _set_mass(chassis: Any, parameters: RobotParameters, growth: np.ndarray) -> None:
    """Set mass, its centre and inertia; the mass distribution scales with the shape, by `growth` (3,) along x, y, z."""
    second = np.array(chassis.inertia) * (parameters.mass / chassis.mass)
    second = (second.sum() / 2 - second) * growth**2  # second moments along x, y, z
    inertia: Sequence[float] = parameters.inertia or (*(second.sum() - second), 0.0, 0.0, 0.0)
    if parameters.yaw_inertia > 0:
        inertia = _with_yaw_inertia(inertia, parameters.yaw_inertia)
    chassis.mass, chassis.ipos = parameters.mass, parameters.centre_of_mass
    chassis.inertia, chassis.fullinertia = [0.0, 0.0, 0.0], inertia


def _with_yaw_inertia(inertia: Sequence[float], yaw_inertia: float) -> tuple[float, ...]:
    """An inertia xx, yy, zz, xy, xz, yz whose masses are moved along the ground so that zz is `yaw_inertia`."""
    xx, yy, zz, xy, xz, yz = inertia
    moments = (xx + yy + zz) / 2 * np.eye(3) - [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    away = np.sqrt([yaw_inertia / zz, yaw_inertia / zz, 1.0])
    moments *= np.outer(away, away)
    moved = np.trace(moments) * np.eye(3) - moments
    return tuple(moved[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]].tolist())
