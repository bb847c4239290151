"""Contact pairs of tracks and terrain."""

from __future__ import annotations

from collections.abc import Iterable

import mujoco
import numpy as np

from sim.tracks.mobility import mobility
from sim.tracks.parts import TrackParts
from sim.tracks.presets import ContactParameters
from trackslip.errors import InvalidValueError, require, require_at_most, require_positive

_MAX_FRICTION = 10.0
_MAX_MOBILITY = (
    3.0  # up to which contacts have the stiffness of their preset; more is that of flippers and light limbs [-]
)


def connect(spec: mujoco.MjSpec, tracks: TrackParts, terrain: Iterable[object] | None = None) -> None:
    """Add a contact pair for each geom of the tracks and each of the terrain.

    Args:
        spec: the spec of the tracks. Its masses must be complete: the pairs depend on the robot's weight.
        tracks: the tracks.
        terrain: geoms of the spec, or their names; by default all colliding geoms of the world body.

    Raises:
        InvalidValueError: for a geom that is not in the spec or is already connected, a robot that can't move, and
            friction that differs along and across on anything but a plane.
    """
    grounds = _grounds(spec, tracks, terrain)
    model = spec.copy().compile()
    body = model.body(tracks.bodies[0])
    require(body.weldid[0] != 0, "body", tracks.names[0], "on a body that moves: give the robot a free joint")
    mass = float(model.body_subtreemass[model.body_rootid[body.id]]) * tracks.load
    gravity = float(np.linalg.norm(model.opt.gravity)) or 9.81
    hardness = min(1.0, _MAX_MOBILITY / mobility(model, tracks, mass))
    own = float(model.body_invweight0[body.id, 0])
    for ground in grounds:
        inverse_weight = own + float(model.body_invweight0[model.geom(ground.name).bodyid[0], 0])
        share = mass * inverse_weight / tracks.points
        contacts = {
            weight: tracks.preset.contact(gravity, share, hardness, weight) for weight in sorted(set(tracks.weights))
        }
        for names in tracks.geoms:
            for name, weight, crosswise in zip(names, tracks.weights, tracks.crosswise, strict=True):
                friction = tracks.friction[::-1] if crosswise else tracks.friction
                _add_pair(spec, ground.name, name, friction, contacts[weight])


def _add_pair(
    spec: mujoco.MjSpec, ground: str, name: str, friction: tuple[float, float], contact: ContactParameters
) -> None:
    spec.add_pair(
        name=f"{ground}/{name}",
        geomname1=ground,
        geomname2=name,
        condim=3,
        margin=0.0,
        gap=0.0,
        adhesion=0.0,
        friction=[*friction, 0.0, 0.0, 0.0],
        solref=contact.solref,
        solimp=contact.solimp,
        solreffriction=contact.solreffriction,
    )


def _grounds(spec: mujoco.MjSpec, tracks: TrackParts, terrain: Iterable[object] | None) -> list[mujoco.MjsGeom]:
    if terrain is None:
        grounds = [geom for geom in spec.worldbody.geoms if geom.contype or geom.conaffinity]
    else:
        grounds = [_geom(spec, each) for each in terrain]
    require(grounds, "terrain", [], "at least one geom: the world body has none that collides")
    paired = {pair.name for pair in spec.pairs}
    for number, geom in enumerate(grounds):
        if not geom.name:
            geom.name = f"{tracks.names[0]}_terrain{number}"
        plane = geom.type == mujoco.mjtGeom.mjGEOM_PLANE
        allowed = f"equal along and across, except on planes; {geom.name} is no plane"
        require(plane or tracks.friction[0] == tracks.friction[1], "friction", tracks.friction, allowed)
        free = f"{geom.name}/{tracks.geoms[0][0]}" not in paired
        require(free, "terrain", geom.name, f"connected with {tracks.names[0]} only once")
    return grounds


def _geom(spec: mujoco.MjSpec, geom: object) -> mujoco.MjsGeom:
    found = spec.geom(geom) if isinstance(geom, str) else geom
    if not isinstance(found, mujoco.MjsGeom):
        names = ", ".join(each.name for each in spec.worldbody.geoms if each.name)
        raise InvalidValueError("terrain", geom, f"a geom of the spec: {names}")
    return found


def require_friction(friction: tuple[float, float]) -> None:
    """Raise InvalidValueError unless friction is a pair of positive coefficients."""
    require(np.shape(friction) == (2,), "friction", friction, "two coefficients, along and across the belt")
    for value in friction:
        require_positive("friction", value)
        require_at_most("friction", value, _MAX_FRICTION)
