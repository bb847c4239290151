"""Attachment of tracks to a body in a MuJoCo spec, and contact pairs between tracks and terrain.

`sim.tracks.description` sets the contact parameters once the model is compiled.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from sim.tracks.description import Description, descriptions
from sim.tracks.hull import Hull
from sim.tracks.recipe import load_preset, set_options, shared_timestep
from sim.tracks.track import WHEEL_WEIGHT, WHEELS, Track
from trackslip.errors import InvalidValueError, require

SENSED = 1 << 0 | 1 << 1 | 1 << 3 | 1 << 5 | 1 << 6 | 1 << 7
"""Bits of the data that a contact sensor reports per contact: found, force, dist, normal, tangent,
linvel.
"""
_FINER = 10.0  # factor on the preset's impratio, as sliding is slower near a wide robot's pivot [-]
_MAX_FORCE = 2  # a contact sensor's reduction mode: the largest forces first
# they take about 0.3 ms per step, five times as long as the rest of a robot's step
_MAX_PAIRS = 20_000
_MOST = mujoco.mjMAXCONPAIR  # most contacts that the engine keeps between two geoms
# most contacts of a capsule with a height field: per cell along it, plus a constant
_PER_CELL, _ENDS = 4.2, 4.0
_TWICE = 4  # sensor slots per contact with solids: the belt may touch two, and its cores as well
# sensor slots per possible contact with a height field; a belt rarely has all of them [-]
_MARGIN = 1.5
_CAPSULE, _HFIELD = mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_HFIELD


def add_tracks(
    spec: mujoco.MjSpec,
    body: str | mujoco.MjsBody,
    track: Track,
    terrain: Iterable[object] | None = None,
    axes: ArrayLike | None = None,
) -> tuple[str, ...]:
    """Add a track, or a pair of tracks, to a body in a MuJoCo spec, and return the tracks' names.

    Args:
        spec: the model, not yet compiled.
        body: the body, or its name, that carries the tracks.
        track: the track or the pair to add.
        terrain: geoms, or their names, to connect with the tracks immediately; if omitted, call
            `connect` later.
        axes: matrix (3, 3) whose columns point forwards, left and up in the body's frame. By
            default, these are the body's x, y and z axes.

    Raises:
        InvalidValueError: for a body that is not in the spec, a name that is already used, terrain
            that can't be connected, or a time step at which the preset isn't stable.
    """
    carrier = spec.body(body) if isinstance(body, str) else body
    if carrier is None:
        known = ", ".join(each.name for each in spec.bodies if each.name)
        raise InvalidValueError("body", body, f"a body of the spec: {known}")
    require(carrier.name != "world", "body", carrier.name, "a body that moves")
    grounds = None if terrain is None else find_grounds(spec, terrain, track.friction)
    name = track.name or carrier.name
    require(name, "name", name, "given: the body has no name")
    names = tuple("_".join(filter(None, (name, end))) for end, _ in track.sides)
    for each in names:
        taken = (
            spec.body(f"{each}_track")
            or spec.sensor(f"{each}_track")
            or spec.geom(f"{each}_track_wheel0")
        )
        require(not taken, "name", name, f"another: the spec has a {each}_track already")
    preset = load_preset(track.preset)
    shared_timestep(spec, [preset, *(each.preset for each in descriptions(spec).values())])
    parts = track.parts()
    count = track.segment_count
    geoms = []
    for each, (_, sign) in zip(names, track.sides, strict=True):
        frame = carrier.add_body(name=f"{each}_track")
        _place(frame, track.offset + sign * track.half_gauge, axes)
        for part in parts:
            geoms.append(f"{each}_track_{part.name}")
            geom = frame.add_geom(
                name=geoms[-1], mass=0, contype=0, conaffinity=0, group=3, **part.shape
            )
            if track.contact == WHEELS:  # outwards is to the left of a left track
                geom.pos[1] *= sign
            # not a default's, such as its euler angles
            geom.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
        spec.add_sensor(
            name=f"{each}_track",
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            reftype=mujoco.mjtObj.mjOBJ_BODY,
            refname=f"{each}_track",
            intprm=[SENSED, _MAX_FORCE, 1],  # `connect` adds slots for contacts
        )
    on_wheels = track.contact == WHEELS
    depths = (preset.core_depth, preset.edge_depth)
    fine = not on_wheels and count > preset.segments
    description = Description(
        preset=replace(preset, impratio=_FINER * preset.impratio) if fine else preset,
        friction=(float(track.friction[0]), float(track.friction[1])),
        load=track.load,
        points=len(names) * (len(parts) if on_wheels else 2 * (count + WHEEL_WEIGHT)),
        segment=Hull.from_wheels(track.chain).longest_below / count,
        geoms=tuple(geoms),
        weights=tuple(part.weight for part in parts) * len(names),
        cores=tuple(depths[part.edge] if part.cored else 0.0 for part in parts) * len(names),
    )
    description.write(spec, name)
    if grounds is not None:
        connect_tracks(spec, name, description, grounds)
    return names


def _place(frame: mujoco.MjsBody, left: float, axes: ArrayLike | None) -> None:
    """Place a track's frame at a distance to the left of its body's frame [m]."""
    if axes is None:
        frame.pos = [0.0, left, 0.0]
        return
    turned = np.asarray(axes, float)
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, turned.ravel())
    frame.pos = left * turned[:, 1]
    frame.quat = quaternion


def connect(spec: mujoco.MjSpec, terrain: Iterable[object] | None = None) -> None:
    """Add the missing contact pairs between the terrain and all tracks in a spec.

    This makes the spec's cone elliptic, raises its impratio to at least 10,000, and replaces
    MuJoCo's default time step with the shortest one of the tracks' presets.

    Args:
        spec: a spec with tracks, attached robots included.
        terrain: geoms of the spec, or their names; by default all colliding geoms of the world and
            of bodies fixed to it. On a body that doesn't move, the belts of a conveyor carry bodies
            that do: name the geoms of these.

    Raises:
        InvalidValueError: for a geom that is not in the spec, a spec without tracks, and different
            friction along and across the tracks if any terrain is not a plane.
    """
    tracks = descriptions(spec)
    require(tracks, "spec", spec.modelname, "one with tracks: add_tracks adds them")
    for name, description in tracks.items():
        connect_tracks(spec, name, description, find_grounds(spec, terrain, description.friction))


def connect_tracks(
    spec: mujoco.MjSpec, name: str, description: Description, grounds: Sequence[mujoco.MjsGeom]
) -> None:
    """Connect the tracks called `name` with the geoms `grounds`; see `connect`."""
    cored = sum(depth > 0 for depth in description.cores)
    pairs = (len(description.geoms) + cored) * len(grounds)
    allowed = (
        f"at most {_MAX_PAIRS:,}, each of which takes time in every step: name what is in "
        "reach, or fewer geoms"
    )
    shown = f"{len(grounds):,} geoms, {pairs:,} contact pairs with {name}"
    require(pairs <= _MAX_PAIRS, "terrain", shown, allowed)
    _make_room(spec, description, min(_cells(spec, grounds)))
    free = (name for k in itertools.count(1) if not spec.geom(name := f"terrain{k}"))
    connected = {(pair.geomname1, pair.geomname2) for pair in spec.pairs}
    for ground in grounds:
        ground.name = ground.name or next(free)
        if (ground.name, description.geoms[0]) in connected:
            continue
        for geom, depth in zip(description.geoms, description.cores, strict=True):
            friction = list(description.friction)
            # lateral
            if (
                geom.rpartition("_track_")[2].startswith("wheel")
                and spec.geom(geom).type == _CAPSULE
            ):
                friction.reverse()
            for suffix, margin in (("", 0.0), ("_core", -depth))[: 1 + (depth > 0)]:
                pair = {
                    "geomname1": ground.name,
                    "geomname2": geom,
                    "condim": 3,
                    "friction": [*friction, 0, 0, 0],
                }
                spec.add_pair(
                    name=f"{ground.name}/{geom}{suffix}",
                    margin=margin,
                    gap=0.0,
                    adhesion=0.0,
                    **pair,
                )
    spec.option.timestep = shared_timestep(
        spec, [each.preset for each in descriptions(spec).values()]
    )
    set_options(spec.option, description.preset)


def _make_room(spec: mujoco.MjSpec, description: Description, cell: float) -> None:
    """Give the tracks' sensors enough slots for contacts; `cell` is the height fields' smallest
    cell, inf for none [m].

    Raises InvalidValueError for capsules that are so long that the engine might not keep all of
    their contacts.
    """
    slots: dict[str, float] = {}
    for name, depth in zip(description.geoms, description.cores, strict=True):
        geom = spec.geom(name)
        length = 2 * geom.size[1] if geom.type == _CAPSULE else 0.0
        on_field = _PER_CELL * length / cell + _ENDS
        shortest = f"{_PER_CELL * length / (_MOST - _ENDS):.3g}"
        least = f"at least {shortest} m under capsules of {length:.3g} m; or more segments"
        require(on_field <= _MOST or not depth, "cell of the height field", f"{cell:.3g} m", least)
        if depth:
            on_solids = _TWICE * (2 if geom.type == _CAPSULE else 1)
            most = max(on_solids, _MARGIN * on_field if cell < math.inf else 0)
            slots[geom.parent.name] = slots.get(geom.parent.name, 0.0) + most
    for body, count in slots.items():
        sensor = spec.sensor(body)
        sensor.intprm[2] = max(sensor.intprm[2], math.ceil(count))


def _cells(spec: mujoco.MjSpec, grounds: Sequence[mujoco.MjsGeom]) -> Iterator[float]:
    """Shorter side of each height field's cells, and inf for other geoms [m]."""
    fields = [geom for geom in grounds if geom.type == _HFIELD]
    model = (
        spec.copy().compile()
        if any(not spec.hfield(geom.hfieldname).nrow for geom in fields)
        else None
    )
    for geom in grounds:
        if geom.type != _HFIELD:
            yield math.inf
            continue
        field = spec.hfield(geom.hfieldname)
        if model is not None:
            field = model.hfield(field.name)
        shape = np.ravel([field.ncol, field.nrow])
        yield float((2 * np.array(field.size[:2]) / (shape - 1)).min())


def find_grounds(
    spec: mujoco.MjSpec, terrain: Iterable[object] | None, friction: tuple[float, float]
) -> list[mujoco.MjsGeom]:
    """The geoms of the terrain; `terrain` and errors are those of `connect`."""
    if terrain is None:
        grounds = [
            geom for geom in _static_geoms(spec.worldbody) if geom.contype or geom.conaffinity
        ]
    else:
        listed = [terrain] if isinstance(terrain, str | mujoco.MjsGeom) else terrain
        grounds = [_geom(spec, each) for each in listed]
    require(grounds, "terrain", [], "at least one geom that collides, of a body that doesn't move")
    for geom in grounds:
        plane = geom.type == mujoco.mjtGeom.mjGEOM_PLANE
        allowed = (
            f"equal along and across, except on planes; {geom.name or 'the terrain'} is no plane"
        )
        require(plane or friction[0] == friction[1], "friction", friction, allowed)
    return grounds


def _static_geoms(body: mujoco.MjsBody) -> Iterator[mujoco.MjsGeom]:
    yield from body.geoms
    for child in body.bodies:
        if not child.joints and not child.mocap:
            yield from _static_geoms(child)


def _geom(spec: mujoco.MjSpec, geom: object) -> mujoco.MjsGeom:
    chosen = spec.geom(geom) if isinstance(geom, str) else geom
    if not isinstance(chosen, mujoco.MjsGeom) or not any(each == chosen for each in spec.geoms):
        names = ", ".join(each.name for each in _static_geoms(spec.worldbody) if each.name)
        shown = geom.name if isinstance(geom, mujoco.MjsGeom) else geom
        raise InvalidValueError(
            "terrain", shown, f"a geom of the spec, such as {names or 'one of the world body'}"
        )
    return chosen
