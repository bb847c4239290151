"""Contact pairs of tracks and terrain: stiffness matched to the points' mobility, and hard cores for landings."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from typing import Any

import mujoco
import numpy as np

from sim.tracks.parts import WHEEL_WEIGHT, TrackParts
from sim.tracks.presets import set_options
from trackslip.errors import InvalidValueError, TrackslipError, first_line, require, require_at_most, require_positive

_MAX_FRICTION = 10.0
_WHEEL_BRAKE = 0.4  # share of its speed that a robot which lands on its wheels loses by them in one physics step [-]
_MAX_MOBILITY = 6.0  # contacts have the stiffness of their preset up to this: a robot's, not a flipper's [-]
_MAX_FIELD_MOBILITY = 3.0  # the same of robots on height fields, where points touch several times [-]
_FIELD_HARDNESS = (0.1, 0.5)  # on height fields of the finest and of the coarsest cells [-]
_CORE_IMPEDANCE = 0.95  # [-]
_CORE_PUSH = 0.4  # share of its depth by which a core is pushed out in one physics step [-]
_CORE_BRAKE = 0.7  # share of its speed that a core loses in one physics step [-]


def connect(spec: mujoco.MjSpec, tracks: TrackParts, terrain: Iterable[object] | None = None) -> None:
    """Add a contact pair for each geom of the tracks and each of the terrain.

    Args:
        spec: the spec of the tracks. Its masses must be complete: the pairs depend on the robot's weight.
        tracks: the tracks.
        terrain: geoms of the spec, or their names; by default all colliding geoms of the world and of bodies fixed
            to it.

    Raises:
        InvalidValueError: for a geom that is not in the spec or is already connected, tracks that are not in it,
            a robot that can't move, and friction that differs along and across on anything but a plane.
    """
    added = all(spec.body(body) for body in tracks.bodies)
    require(added, "tracks", tracks.names, "in this spec; after attach with a prefix, connect Tracks.prefixed(prefix)")
    grounds = _grounds(spec, tracks, terrain)
    set_options(spec, tracks.preset)
    try:
        model = spec.copy().compile()
    except ValueError as error:
        message = first_line(error).removeprefix("Error: ")
        raise TrackslipError(f"spec: must compile before tracks are connected: {message}") from error
    body = model.body(tracks.bodies[0])
    require(body.weldid[0] != 0, "body", tracks.names[0], "on a body that moves: give the robot a free joint")
    mass = float(model.body_subtreemass[model.body_rootid[body.id]]) * tracks.load
    gravity = float(np.linalg.norm(model.opt.gravity)) or 9.81
    rocks, lightest = mobility(model, tracks, mass)
    on_limb = bool(model.body_weldid[body.id] != model.body_rootid[body.id])
    own = float(model.body_invweight0[body.id, 0])
    for ground in grounds:
        inverse_weight = own + float(model.body_invweight0[model.geom(ground.name).bodyid[0], 0])
        share = mass * inverse_weight / tracks.points
        softened = _field_hardness(model, model.geom(ground.name).id, tracks.segment)
        most = _MAX_MOBILITY if softened is None or on_limb else _MAX_FIELD_MOBILITY
        hardness = min(1.0, most / max(rocks, 1.0)) * (softened or 1.0)
        lightness = max(lightest / inverse_weight, 1.0)  # a robot that is held, as on a test rig, has none
        alone = softened is None  # on height fields a wheel touches several times
        brake = _brake(tracks, mass * inverse_weight * lightness if alone else 0.0)
        contacts = {
            weight: tracks.preset.contact(gravity, share, hardness, weight, lightness, brake[weight])
            for weight in brake
        }
        for names in tracks.geoms:
            for name, part in zip(names, tracks.parts, strict=True):
                along, across = tracks.friction[::-1] if part.crosswise else tracks.friction
                friction = [along, across, 0.0, 0.0, 0.0]
                _add_pair(spec, ground.name, name, condim=3, friction=friction, **vars(contacts[part.weight]))
        if alone and not on_limb:
            connect_cores(spec, ground.name, tracks)


def _brake(tracks: TrackParts, heaviness: float) -> dict[float, float]:
    """Least share of its speed that a contact takes from a geom of each weight in one physics step [-].

    A wheel of a robot that comes down over an edge meets the next edge alone, with as much mass behind it as many
    points of a run share on a plane. Damping stops it and gives nothing back, unlike a stiffer spring. All wheels that
    stand on a plane together take `_WHEEL_BRAKE` from the robot, whose mass is `heaviness` times that of a point.
    """
    wheel = min(_WHEEL_BRAKE * heaviness / (2 * len(tracks.names)), 1.0)
    return {
        weight: 0.0 if weight == 1 else wheel * weight / WHEEL_WEIGHT
        for weight in {part.weight for part in tracks.parts}
    }


def _field_hardness(model: mujoco.MjModel, geom: int, segment: float) -> float | None:
    """Hardness [-] of contacts with a height field, whose vertices touch once for each triangle; None for other geoms.

    The finer its cells, the more of them a capsule of a `segment` of track [m] touches at once.
    """
    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_HFIELD:
        return None
    field = model.geom_dataid[geom]
    cells = model.hfield_ncol[field] - 1, model.hfield_nrow[field] - 1
    finest = float((2 * model.hfield_size[field, :2] / cells).min())
    return float(np.clip(finest / segment, *_FIELD_HARDNESS))


def _add_pair(spec: mujoco.MjSpec, ground: str, name: str, **contact: Any) -> None:
    spec.add_pair(
        name=f"{ground}/{name}", geomname1=ground, geomname2=name, margin=0.0, gap=0.0, adhesion=0.0, **contact
    )


def _grounds(spec: mujoco.MjSpec, tracks: TrackParts, terrain: Iterable[object] | None) -> list[mujoco.MjsGeom]:
    if terrain is None:
        grounds = [geom for geom in _static_geoms(spec.worldbody) if geom.contype or geom.conaffinity]
    else:
        listed = [terrain] if isinstance(terrain, str | mujoco.MjsGeom) else terrain
        grounds = [_geom(spec, each) for each in listed]
    require(grounds, "terrain", [], "at least one geom that collides, of a body that doesn't move")
    for geom in grounds:
        plane = geom.type == mujoco.mjtGeom.mjGEOM_PLANE
        allowed = f"equal along and across, except on planes; {geom.name or 'the terrain'} is no plane"
        require(plane or tracks.friction[0] == tracks.friction[1], "friction", tracks.friction, allowed)
    free = (name for k in itertools.count(1) if not spec.geom(name := f"terrain{k}"))
    paired = {pair.name for pair in spec.pairs}
    for geom in grounds:
        geom.name = geom.name or next(free)
        pair = f"{geom.name}/{tracks.geoms[0][0]}"
        require(pair not in paired, "terrain", geom.name, f"connected with {tracks.names[0]} only once")
        paired.add(pair)
    return grounds


def _static_geoms(body: mujoco.MjsBody) -> Iterator[mujoco.MjsGeom]:
    """Geoms of a body and of the bodies fixed to it."""
    yield from body.geoms
    for child in body.bodies:
        if not child.joints and not child.mocap:
            yield from _static_geoms(child)


def _geom(spec: mujoco.MjSpec, geom: object) -> mujoco.MjsGeom:
    found = spec.geom(geom) if isinstance(geom, str) else geom
    if not isinstance(found, mujoco.MjsGeom) or not any(each == found for each in spec.geoms):
        names = ", ".join(each.name for each in _static_geoms(spec.worldbody) if each.name)
        shown = geom.name if isinstance(geom, mujoco.MjsGeom) else geom
        raise InvalidValueError("terrain", shown, f"a geom of the spec, such as {names or 'one of the world body'}")
    return found


def require_friction(friction: tuple[float, float]) -> None:
    """Raise InvalidValueError unless friction is a pair of positive coefficients."""
    require(np.shape(friction) == (2,), "friction", friction, "two coefficients, along and across the belt")
    for value in friction:
        require_positive("friction", value)
        require_at_most("friction", value, _MAX_FRICTION)


def connect_cores(spec: mujoco.MjSpec, ground: str, tracks: TrackParts) -> None:
    """Add a core to each geom of the tracks that lacks one, and a contact pair with the geom `ground`.

    Cores are hard geoms below the belt's surface. A robot that tips over an edge meets the next one with a wheel or
    two. Contacts soft enough to share a plane with many points then yield by centimetres, and stiffer ones would throw
    a robot that lands on all of them. The core of a wheel or a capsule is the same geom, thinner, so that a robot that
    stands doesn't touch it. The impedance is near 1: such contacts regularise by the bodies' own inertia, so that
    together they never take more than they are asked for, whatever the number of points. They have no friction: in an
    elliptic cone, sliding adds to the normal force of a hard contact.
    """
    step = tracks.preset.timestep
    for body, names in zip(tracks.bodies, tracks.geoms, strict=True):
        for name in (name for name, part in zip(names, tracks.parts, strict=True) if part.cored):
            core = f"{name}_core"
            if not spec.geom(core):
                geom = spec.geom(name)
                size = np.array(geom.size)
                size[0] = max(size[0] - tracks.preset.core, size[0] / 2)
                shape = {"type": geom.type, "pos": geom.pos, "quat": geom.quat, "size": size}
                spec.body(body).add_geom(name=core, mass=0, contype=0, conaffinity=0, group=3, **shape)
            solref = (-_CORE_PUSH * _CORE_IMPEDANCE / step**2, -_CORE_BRAKE * _CORE_IMPEDANCE / step)
            solimp = (_CORE_IMPEDANCE, _CORE_IMPEDANCE, tracks.preset.width, 0.5, 1.0)
            _add_pair(spec, ground, core, condim=1, solref=solref, solimp=solimp)


def mobility(model: mujoco.MjModel, tracks: TrackParts, mass: float) -> tuple[float, float]:
    """Largest ratio [-] of a robot's squared natural frequencies on its tracks to its squared heave frequency.

    The second number is the largest inverse mass of a point of the tracks along its normal [1/kg]. Each run stands on
    springs that together carry the robot's `mass` [kg]. A box on two tracks has about 2 in roll; a light flipper on its
    hinge has more, and springs of that stiffness would throw it off.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_crb(model, data)
    mujoco.mj_factorM(model, data)
    found = [_stiffest(model, data, tracks, mass, run) for run in range(len(tracks.hull.runs))]
    return max(ratio for ratio, _ in found), max(point for _, point in found)


def _stiffest(
    model: mujoco.MjModel, data: mujoco.MjData, tracks: TrackParts, mass: float, run: int
) -> tuple[float, float]:
    shape = tracks.hull.runs[run]
    rows = []
    places = 2 if tracks.segment >= shape.length else 5
    for body in (model.body(name).id for name in tracks.bodies):
        rotation, origin = data.xmat[body].reshape(3, 3), data.xpos[body]
        normal = rotation[:, [0, 2]] @ shape.outwards
        for part in np.linspace(0.0, 1.0, places):
            point = origin + rotation[:, [0, 2]] @ (shape.start + part * (shape.end - shape.start))
            jacobian = np.zeros((3, model.nv))
            mujoco.mj_jac(model, data, jacobian, None, point, body)
            rows.append(normal @ jacobian)
    along = np.array(rows)
    moved = np.zeros_like(along)
    mujoco.mj_solveM(model, data, moved, along)
    inverse = along @ moved.T
    return float(np.linalg.eigvalsh(inverse).max()) * mass / len(rows), float(np.diag(inverse).max())
