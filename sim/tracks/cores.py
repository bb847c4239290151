"""Cores of a track: hard geoms below the belt's surface, for what comes down on few points.

A robot that tips over an edge meets the next one with a wheel or two. Contacts soft enough to share a plane with many
points then yield by centimetres, and stiffer ones would throw a robot that lands on all of them. The core of a wheel or
a capsule is the same geom, thinner, so that a robot that stands doesn't touch it. The impedance is near 1: such
contacts regularise by the bodies' own inertia, so that together they never take more than they are asked for, whatever
the number of points. They have no friction: in an elliptic cone, sliding adds to the normal force of a hard contact.
"""

from __future__ import annotations

import mujoco
import numpy as np

from sim.tracks.parts import TrackParts
from sim.tracks.presets import Preset

_IMPEDANCE = 0.95  # [-]
_PUSH = 0.4  # share of its depth by which a core is pushed out in one physics step [-]
_BRAKE = 0.7  # share of its speed that a core loses in one physics step [-]


def connect_cores(spec: mujoco.MjSpec, ground: str, tracks: TrackParts) -> None:
    """Give the geoms of the tracks cores, unless they have them, and a pair with the geom `ground` each."""
    step = tracks.preset.timestep
    for body, names in zip(tracks.bodies, tracks.geoms, strict=True):
        for name, cored in zip(names, tracks.cored, strict=True):
            if not cored:
                continue
            core = f"{name}_core"
            if not spec.geom(core):
                _add_core(spec.body(body), spec.geom(name), core, tracks.preset)
            spec.add_pair(
                name=f"{ground}/{core}",
                geomname1=ground,
                geomname2=core,
                condim=1,
                margin=0.0,
                gap=0.0,
                adhesion=0.0,
                solref=(-_PUSH * _IMPEDANCE / step**2, -_BRAKE * _IMPEDANCE / step),
                solimp=(_IMPEDANCE, _IMPEDANCE, tracks.preset.width, 0.5, 1.0),
            )


def _add_core(body: mujoco.MjsBody, geom: mujoco.MjsGeom, name: str, preset: Preset) -> None:
    size = np.array(geom.size)
    size[0] = max(size[0] - preset.core, size[0] / 2)
    body.add_geom(
        name=name,
        type=geom.type,
        pos=geom.pos,
        quat=geom.quat,
        size=size,
        mass=0,
        contype=0,
        conaffinity=0,
        group=3,
    )
