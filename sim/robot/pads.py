"""Pads of a robot on flat ground: capsules along the direction of travel, which touch it at two points or at one."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np

from sim.robot.parameters import RobotParameters
from sim.tracks.recipe import LEAST_ODDS, LEVEL, LEVEL_WHEELS, LEVEL_WIDE, Preset, track_points, warn_if_unverified
from trackslip.kinematics import SIDES, Array

_TILT = np.radians(45.0)  # of a pad with one point: its lower end touches, and its axis still gives the directions
_LENGTH = 0.02  # between the ends of such a pad [m]
_SHEARING = 4  # points of a wheel's patch on shearing ground
_GAUSS = (-1 / math.sqrt(12), 1 / math.sqrt(12))  # those elsewhere, which spread as a uniform patch does [-]


def contact_points(parameters: RobotParameters, single: bool) -> tuple[Array, Preset]:
    """Points (n,) of a side along a robot, from rear to front [m], and their recipe.

    A track has the middles of equal segments, a wheel two points, or four on shearing ground, whose pads are `single`.
    """
    if not parameters.axles:
        n = track_points(parameters.half_gauge, parameters.contact_length, LEVEL)
        return parameters.contact_length * _middles(n), LEVEL if n == 2 * LEVEL.segments else LEVEL_WIDE
    warn_if_unverified(parameters.half_gauge, parameters.contact_length)
    points = _middles(_SHEARING) if single else np.array(_GAUSS)
    softest = LEAST_ODDS * 2 * _SHEARING * len(parameters.axles)  # that the engine knows, on any ground
    preset = LEVEL_WHEELS.softer(min(1.0, LEVEL_WHEELS.regularisation / softest))
    return np.add.outer(parameters.axles, parameters.patch_length * points).ravel(), preset


def _middles(count: int) -> Array:
    """Middles (n,) of equal segments, of a length of 1 in all [-]."""
    return (np.arange(count) + 0.5) / count - 0.5


def lay_pads(spec: Any, parameters: RobotParameters, single: bool = False) -> Array:
    """Replace the pads of a model by those that a robot needs, and give their points (n,) of a side [m].

    A pad has two points, unless it is `single`. All points together carry the robot at the same depth, and creep as
    slowly, whatever their number.
    """
    chassis = spec.body("chassis")
    pads, plain = [geom for geom in chassis.geoms if "_pad" in geom.name], spec.pairs[0]
    x, preset = contact_points(parameters, single)
    radius, group, ground, friction = pads[0].size[0], pads[0].group, plain.geomname1, list(plain.friction)
    for thing in (*spec.pairs, *pads):
        spec.delete(thing)
    contact = preset.contact(-float(spec.option.gravity[2]), 1 / (2 * len(x)), preset.regularisation, preset.grip)
    spec.option.impratio = preset.impratio
    raised = _LENGTH * np.array([np.cos(_TILT), 0.0, np.sin(_TILT)])
    for side, y in zip(("left", "right"), parameters.half_gauge * -SIDES, strict=True):
        place = np.stack([x, np.full_like(x, y), np.full_like(x, radius)], axis=1)
        spans = np.hstack([place, place + raised]) if single else place.reshape(-1, 6)
        for k, span in enumerate(spans):
            name, unseen = f"{side}_pad{k}", {"mass": 0.0, "contype": 0, "conaffinity": 0, "group": group}
            chassis.add_geom(
                name=name, type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[radius, 0.0, 0.0], fromto=span, **unseen
            )
            spec.add_pair(geomname1=ground, geomname2=name, condim=3, friction=friction, **vars(contact))
    return x
