"""Pads that touch the ground at one point each, as ground that shears needs."""

from __future__ import annotations

import mujoco
import numpy as np

_TILT = np.radians(45.0)  # of a pad: only its lower end touches, and its axis still gives the contact's directions
_LENGTH = 0.02  # between the ends of a pad [m]


def split_pads(spec: mujoco.MjSpec) -> None:
    """Replace every capsule that lies on the ground by two tilted ones, whose lower ends touch where its ends did."""
    chassis = spec.body("chassis")
    raised = _LENGTH * np.array([np.cos(_TILT), 0.0, np.sin(_TILT)])
    pairs = {pair.geomname2: pair for pair in spec.pairs}
    pads = [geom for geom in chassis.geoms if "_pad" in geom.name]
    for side in ("left", "right"):
        ends = np.concatenate([_ends(pad) for pad in pads if pad.name.startswith(side)])
        for k, place in enumerate(ends[np.argsort(ends[:, 0])]):
            name = f"{side}_pad{k}_single"
            like = pads[0]
            chassis.add_geom(
                name=name,
                type=like.type,
                size=[like.size[0], 0.0, 0.0],
                fromto=[*place, *(place + raised)],
                mass=0.0,
                contype=0,
                conaffinity=0,
                group=like.group,
            )
            pair = pairs[like.name]
            spec.add_pair(
                geomname1=pair.geomname1,
                geomname2=name,
                condim=pair.condim,
                friction=pair.friction,
                solref=pair.solref,
                solreffriction=pair.solreffriction,
                solimp=pair.solimp,
            )
    for pad in pads:
        spec.delete(pairs[pad.name])
        spec.delete(pad)


def _ends(pad: mujoco.MjsGeom) -> np.ndarray:
    return np.array(pad.fromto).reshape(2, 3)
