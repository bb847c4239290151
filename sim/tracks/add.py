"""Tracks bolted to a body of a MuJoCo spec: capsules along the runs of the belt, spheres at its wheels."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import mujoco

from sim.tracks.connect import connect_tracks, find_grounds
from sim.tracks.description import Description
from sim.tracks.hull import Hull
from sim.tracks.parts import WHEEL_WEIGHT, Part
from sim.tracks.recipe import Preset, load_preset, require_stable
from sim.tracks.track import WHEELS, Track
from trackslip.errors import InvalidValueError, require

SENSED = 1 << 0 | 1 << 1 | 1 << 3 | 1 << 5 | 1 << 6 | 1 << 7
"""Data that a contact sensor reports per contact, as bits: found, force, dist, normal, tangent, linvel."""
_FINER = 10.0  # impratio over the preset's, for the slower sliding next to the pivot of a wide robot [-]
_MAX_FORCE = 2  # reduction of a contact sensor: the largest forces first


def add_tracks(
    spec: mujoco.MjSpec, body: str | mujoco.MjsBody, track: Track, terrain: Iterable[object] | None = None
) -> tuple[str, ...]:
    """Add a track, or a pair of tracks, to a body of a MuJoCo spec, and give their names.

    Args:
        spec: a model that is not compiled yet.
        body: name of the body that carries the tracks, or the body; x forwards, y left, z up.
        track: what to add.
        terrain: geoms, or their names, to `connect` the tracks with at once; otherwise call `connect`.

    Raises:
        InvalidValueError: for a body that is not in the spec, a name that is taken, terrain that can't be connected, or
            a time step at which the preset isn't stable.
    """
    carrier = _body(spec, body)
    grounds = None if terrain is None else find_grounds(spec, terrain, track.friction)
    name = track.name or carrier.name
    require(name, "name", name, "given: the body has no name")
    names = tuple("_".join(filter(None, (name, end))) for end, _ in track.sides)
    for each in names:
        taken = spec.body(f"{each}_track") or spec.sensor(f"{each}_track") or spec.geom(f"{each}_track_wheel0")
        require(not taken, "name", name, f"another: the spec has a {each}_track already")
    preset = load_preset(track.preset)
    if spec.option.timestep != mujoco.MjSpec().option.timestep:
        require_stable(spec.option.timestep, preset)
    parts, count = track.parts(), track.segment_count
    geoms = []
    for each, (_, sign) in zip(names, track.sides, strict=True):
        frame = carrier.add_body(name=f"{each}_track", pos=[0.0, sign * track.half_gauge, 0.0])
        for part in parts:
            geoms.append(f"{each}_track_{part.name}")
            frame.add_geom(name=geoms[-1], mass=0, contype=0, conaffinity=0, group=3, **part.shape)
        spec.add_sensor(
            name=f"{each}_track",
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            reftype=mujoco.mjtObj.mjOBJ_BODY,
            refname=f"{each}_track",
            intprm=[SENSED, _MAX_FORCE, 1],  # connect makes room for contacts
        )
    on_wheels = track.contact == WHEELS
    fine = not on_wheels and count > preset.segments
    description = Description(
        preset=replace(preset, impratio=_FINER * preset.impratio) if fine else preset,
        friction=(float(track.friction[0]), float(track.friction[1])),
        load=track.load,
        points=len(names) * (len(parts) if on_wheels else 2 * (count + WHEEL_WEIGHT)),
        segment=Hull.from_wheels(track.hull).longest_below / count,
        geoms=tuple(geoms),
        weights=tuple(part.weight for part in parts) * len(names),
        cores=tuple(_core_depth(part, preset) for part in parts) * len(names),
    )
    description.write(spec, name)
    if grounds is not None:
        connect_tracks(spec, name, description, grounds)
    return names


def _core_depth(part: Part, preset: Preset) -> float:
    """Depth of a geom's core, 0 for none [m]."""
    if not part.cored:
        return 0.0
    return preset.edge_depth if part.edge else preset.core_depth


def _body(spec: mujoco.MjSpec, body: str | mujoco.MjsBody) -> mujoco.MjsBody:
    carrier = spec.body(body) if isinstance(body, str) else body
    if carrier is None:
        names = ", ".join(each.name for each in spec.bodies if each.name)
        raise InvalidValueError("body", body, f"a body of the spec: {names}")
    require(carrier.name != "world", "body", carrier.name, "a body that moves")
    return carrier
