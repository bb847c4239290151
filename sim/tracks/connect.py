"""Contact pairs of tracks and terrain: matched to the robot's mobility, and hard cores for landings."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence

import mujoco
import numpy as np

from sim.tracks.parts import TrackParts
from sim.tracks.recipe import ContactParameters, set_options
from trackslip.errors import InvalidValueError, TrackslipError, in_one_line, require, require_at_most, require_positive

_MAX_FRICTION = 10.0
_MAX_PAIRS = 20_000  # about 0.3 ms a step, five times as much as everything else of a robot
_MOST = mujoco.mjMAXCONPAIR  # contacts of two geoms that the engine keeps
_PER_CELL, _ENDS = 4.2, 4.0  # most contacts of a capsule with a height field: for each cell of its length, and more
_TWICE = 4  # contacts that a sensor reports for each that a belt has on a solid: on two of them, and with cores
_MARGIN = 1.5  # the same for a height field, all of which a belt rarely touches [-]
_FINER = 10.0  # impratio over the least, for the slower sliding next to the pivot of a wide robot [-]


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
    set_options(spec, tracks.preset, _FINER if tracks.segments > tracks.preset.segments else 1.0)
    try:
        model = spec.copy().compile()
    except ValueError as error:
        raise TrackslipError(f"spec: must compile before tracks are connected: {in_one_line(error)}") from error
    body = model.body(tracks.bodies[0])
    require(body.weldid[0] != 0, "body", tracks.names[0], "on a body that moves: give the robot a free joint")
    mass = float(model.body_subtreemass[model.body_rootid[body.id]]) * tracks.load
    gravity = float(np.linalg.norm(model.opt.gravity)) or 9.81
    rocks = max(mobility(model, tracks, mass), 1.0)  # a robot that is held, as on a test rig, has none
    own, core = float(model.body_invweight0[body.id, 0]), tracks.preset.core()
    pairs = sum(1 + part.cored for part in tracks.parts) * len(tracks.names) * len(grounds)
    allowed = f"at most {_MAX_PAIRS:,}, each of which takes time in every step: name what is in reach, or fewer geoms"
    require(
        pairs <= _MAX_PAIRS,
        "terrain",
        f"{len(grounds):,} geoms, {pairs:,} contact pairs with {tracks.names[0]}",
        allowed,
    )
    lightest = min(part.weight for part in tracks.parts)
    grip = tracks.preset.grip * tracks.preset.regularisation / tracks.preset.regularise(gravity, rocks, np.inf)
    _make_room(spec, tracks, [_finest_cell(model, ground.name) for ground in grounds])
    for ground in grounds:
        terrain_geom = model.geom(ground.name)
        share = mass * (own + float(model.body_invweight0[terrain_geom.bodyid[0], 0])) / tracks.points
        field = terrain_geom.type[0] == mujoco.mjtGeom.mjGEOM_HFIELD  # a point of it may touch any number of times
        regularisation = tracks.preset.regularise(gravity, np.inf if field else rocks, share * lightest)
        for names in tracks.geoms:
            for name, part in zip(names, tracks.parts, strict=True):
                along, across = tracks.friction[::-1] if part.crosswise else tracks.friction
                friction = [along, across, 0.0, 0.0, 0.0]
                belt = tracks.preset.contact(gravity, share * part.weight, regularisation, grip)
                _add_pair(spec, ground.name, name, "", 0.0, friction, belt)
                if part.cored:
                    depth = tracks.preset.edge_depth if part.edge else tracks.preset.core_depth
                    _add_pair(spec, ground.name, name, "_core", depth, friction, core)


def _make_room(spec: mujoco.MjSpec, tracks: TrackParts, cells: Sequence[float]) -> None:
    """Let the tracks' sensors report the contacts with height fields of these `cells`, inf for other geoms [m].

    Raises InvalidValueError for capsules so long that they may have more contacts than the engine keeps.
    """
    finest, slots = min(cells), 0.0
    for part in tracks.parts:
        capsule = part.shape["type"] == mujoco.mjtGeom.mjGEOM_CAPSULE
        length = 2 * part.shape["size"][1] if capsule else 0.0
        on_field = _PER_CELL * length / finest + _ENDS
        least = (
            f"at least {_PER_CELL * length / (_MOST - _ENDS):.3g} m under capsules of {length:.3g} m; or more segments"
        )
        require(on_field <= _MOST or not part.cored, "cell of the height field", f"{finest:.3g} m", least)
        if part.cored:
            slots += max(_TWICE * (2 if capsule else 1), _MARGIN * on_field if finest < math.inf else 0)
    for body in tracks.bodies:
        sensor = spec.sensor(body)
        sensor.intprm[2] = max(sensor.intprm[2], math.ceil(slots))


def _finest_cell(model: mujoco.MjModel, geom: str) -> float:
    """Smaller side of a height field's cells, inf for another geom [m]."""
    ground = model.geom(geom)
    if ground.type[0] != mujoco.mjtGeom.mjGEOM_HFIELD:
        return math.inf
    field = ground.dataid[0]
    length, width = 2 * model.hfield_size[field, :2] / [model.hfield_ncol[field] - 1, model.hfield_nrow[field] - 1]
    return float(min(length, width))


def _add_pair(
    spec: mujoco.MjSpec,
    ground: str,
    name: str,
    suffix: str,
    depth: float,
    friction: list[float],
    contact: ContactParameters,
) -> None:
    """Add a pair whose contacts push from `depth` on [m]."""
    pair = f"{ground}/{name}{suffix}"
    geoms = {"name": pair, "geomname1": ground, "geomname2": name, "condim": 3, "friction": friction}
    spec.add_pair(**geoms, margin=-depth, gap=0.0, adhesion=0.0, **vars(contact))


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


def mobility(model: mujoco.MjModel, tracks: TrackParts, mass: float) -> float:
    """Largest ratio [-] of a robot's squared natural frequencies on its tracks to its squared heave frequency.

    Each run stands on springs that together carry the robot's `mass` [kg]. A box on two tracks has about 3 in roll; a
    light flipper on its hinge has more.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_crb(model, data)
    mujoco.mj_factorM(model, data)
    return max(_stiffest(model, data, tracks, mass, run) for run in range(len(tracks.hull.runs)))


def _stiffest(model: mujoco.MjModel, data: mujoco.MjData, tracks: TrackParts, mass: float, run: int) -> float:
    shape = tracks.hull.runs[run]
    rows = []
    places = 2 if tracks.segment >= shape.length else 5
    for body in (model.body(name).id for name in tracks.bodies):
        rotation, origin = data.xmat[body].reshape(3, 3), data.xpos[body]
        normal = rotation[:, [0, 2]] @ shape.outwards
        for part, (aside, load) in itertools.product(np.linspace(0.0, 1.0, places), tracks.lines):
            point = origin + rotation[:, [0, 2]] @ (shape.start + part * (shape.end - shape.start))
            point += aside * rotation[:, 1]
            jacobian = np.zeros((3, model.nv))
            mujoco.mj_jac(model, data, jacobian, None, point, body)
            rows.append(math.sqrt(load) * (normal @ jacobian))
    along = np.array(rows)
    moved = np.zeros_like(along)
    mujoco.mj_solveM(model, data, moved, along)
    return float(np.linalg.eigvalsh(along @ moved.T).max()) * mass * len(tracks.lines) / len(rows)
