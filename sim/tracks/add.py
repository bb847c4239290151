"""Tracks bolted to a body of a MuJoCo spec: capsules along the runs of the belt, spheres at its wheels."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import mujoco

from sim.tracks.belts import Belts, bind
from sim.tracks.connect import connect, require_friction
from sim.tracks.hull import Hull
from sim.tracks.parts import TrackParts, lines_across, track_parts
from sim.tracks.recipe import Preset, load_preset, require_stable, track_points
from trackslip.errors import (
    InvalidValueError,
    TrackslipError,
    require,
    require_at_most,
    require_finite,
    require_non_negative,
    require_positive,
    require_whole,
)

SENSED = 1 << 0 | 1 << 1 | 1 << 3 | 1 << 5 | 1 << 6 | 1 << 7
"""Data that a contact sensor reports per contact, as bits: found, force, dist, normal, tangent, linvel."""
_MAX_SEGMENTS = 40
_MAX_HALF_GAUGE = 10.0  # [m]
_MAX_LINES = 9
_MAX_FORCE = 2  # reduction of a contact sensor: the largest forces first
_SIDES = {"both": (("left", 1.0), ("right", -1.0)), "left": (("", 1.0),), "right": (("", -1.0),)}


def add_tracks(
    spec: mujoco.MjSpec,
    body: str | mujoco.MjsBody,
    *,
    half_gauge: float,
    hull: Sequence[Sequence[float]],
    preset: str | Preset = "accurate",
    friction: tuple[float, float] = (0.7, 0.7),
    name: str = "",
    side: str = "both",
    load: float = 1.0,
    segments: int | None = None,
    width: float = 0.0,
    lines: int = 3,
    terrain: Iterable[object] | None = None,
) -> Tracks:
    """Add a track, or a pair of tracks, to a body of a MuJoCo spec.

    Connecting them makes the spec's cone elliptic and its impratio 10,000 at least, and turns a time step that is
    MuJoCo's default into the preset's.

    Args:
        spec: a model that is not compiled yet.
        body: name of the body that carries the tracks, or the body; x forwards, y left, z up.
        half_gauge: half of the distance between the middles of two tracks; with one track, its distance to the left or
            right of the body's frame, which may be 0 [m].
        hull: wheels (x, z, radius) in the body's frame [m]; the belt is their convex hull.
        preset: "accurate" (2 ms), "fast" (4 ms), or a recipe of your own.
        friction: coefficients along and across the belt [-]. They may differ on planes only.
        name: of the track; two are called NAME_left and NAME_right. By default the body's name.
        side: "both", "left" or "right".
        load: part of the robot's weight that these tracks carry when the robot stands on them [-].
        segments: capsules along the longest run below. By default as many as the preset has, more for a robot that is
            wide for its length, which spread the load for turns to be exact; for a single track, such as a flipper's,
            two.
        width: of the belts on the ground; by default they touch along a line in their middle [m].
        lines: of contact across that width, the outermost at its edges. Three turn like an even pressure; two, which
            are faster, like narrow belts there.
        terrain: geoms, or their names, to `connect` the tracks with at once; otherwise call `Tracks.connect`.

    Raises:
        InvalidValueError: for a body that is not in the spec, a name that is taken, an impossible hull, or a time step
            at which the preset isn't stable.
    """
    carrier = _body(spec, body)
    require(side in tuple(_SIDES), "side", side, f"one of {', '.join(_SIDES)}")
    (require_positive if side == "both" else require_finite)("half_gauge", half_gauge)
    require(abs(half_gauge) <= _MAX_HALF_GAUGE, "half_gauge", half_gauge, f"at most {_MAX_HALF_GAUGE:g} m")
    require_positive("load", load)
    require_at_most("load", load, 1.0)
    require_friction(friction)
    shape, recipe = Hull.from_wheels(hull), load_preset(preset)
    count = segments
    if count is None:
        count = 2 * math.ceil(track_points(half_gauge, shape.longest_below, recipe) / 4) if side == "both" else 2
    require_whole("segments", count, 1, _MAX_SEGMENTS)
    require_non_negative("width", width)
    widest = 2 * half_gauge if side == "both" else _MAX_HALF_GAUGE
    require(width < widest, "width", width, f"less than {widest:g} m")
    require_whole("lines", lines, 1, _MAX_LINES)
    across = lines_across(width, lines)
    prefix = name or carrier.name
    require(prefix, "name", name, "given: the body has no name")
    names = tuple("_".join(filter(None, (prefix, which))) for which, _ in _SIDES[side])
    bodies = tuple(f"{track}_track" for track in names)
    for track in bodies:
        taken = any(
            find(each) for find, each in ((spec.body, track), (spec.sensor, track), (spec.geom, f"{track}_wheel0"))
        )
        require(not taken, "name", prefix, f"another: the spec has a {track} already")
    if spec.option.timestep != mujoco.MjSpec().option.timestep:
        require_stable(spec.option.timestep, recipe)
    anisotropic = friction[0] != friction[1]
    parts = track_parts(shape, count, anisotropic, across)
    for track, (_, sign) in zip(bodies, _SIDES[side], strict=True):
        frame = carrier.add_body(name=track, pos=[0.0, sign * half_gauge, 0.0])
        for part in parts:
            frame.add_geom(name=f"{track}_{part.name}", mass=0, contype=0, conaffinity=0, group=3, **part.shape)
        spec.add_sensor(
            name=track,
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            reftype=mujoco.mjtObj.mjOBJ_BODY,
            refname=track,
            intprm=[SENSED, _MAX_FORCE, 1],  # connect makes room for contacts
        )
    pair = float(friction[0]), float(friction[1])
    tracks = Tracks(names, shape, recipe, pair, load, count, parts, across)
    if terrain is not None:
        try:
            tracks.connect(spec, terrain)
        except TrackslipError:
            for track in bodies:
                spec.delete(spec.sensor(track))
                spec.delete(spec.body(track))
            raise
    return tracks


def _body(spec: mujoco.MjSpec, body: str | mujoco.MjsBody) -> mujoco.MjsBody:
    found = spec.body(body) if isinstance(body, str) else body
    if found is None:
        names = ", ".join(each.name for each in spec.bodies if each.name)
        raise InvalidValueError("body", body, f"a body of the spec: {names}")
    require(found.name != "world", "body", found.name, "a body that moves")
    return found


@dataclass(frozen=True)
class Tracks(TrackParts):
    """The tracks of one call of `add_tracks`: each a body without joints, with its geoms and a contact sensor."""

    def prefixed(self, prefix: str) -> Tracks:
        """Return these tracks with the prefix that `attach` gave to their names."""
        return replace(self, names=tuple(prefix + name for name in self.names))

    def connect(self, spec: mujoco.MjSpec, terrain: Iterable[object] | None = None) -> None:
        """Add contacts between these tracks and the geoms `terrain`; see `sim.tracks.connect.connect`."""
        connect(spec, self, terrain)

    def bind(self, model: mujoco.MjModel) -> Belts:
        """Return the belts of these tracks in a compiled model; see `sim.tracks.belts.bind`."""
        return bind(model, self)
