"""Tracks bolted to a body: lines of capsules along the belt's runs, with spheres at its wheels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.tracks.hull import Hull, wheel_numbers
from sim.tracks.recipe import Preset, load_preset, track_points
from trackslip.errors import (
    Checked,
    checked,
    require,
    require_finite,
    require_non_negative,
    require_positive,
    require_whole,
    require_within,
)

Lines = tuple[tuple[float, float], ...]
"""Lines of contact: lateral distance from the belt's middle [m], and share of the belt's load
[-].
"""
WHEEL_WEIGHT = 0.5
"""Load on a wheel that stands on a plane, relative to the load on a capsule's end [-]."""
_MAX_RUN_RADIUS = 0.03  # [m]
TRACKS, WHEELS = "tracks", "wheels"
"""Kinds of contact with the ground."""
_SIDES = {"both": (("left", 1.0), ("right", -1.0)), "left": (("", 1.0),), "right": (("", -1.0),)}
_MAX_SEGMENTS = 40
_MAX_HALF_GAUGE = 10.0  # [m]
_MAX_FRICTION = 10.0


@dataclass(frozen=True)
class Part:
    """A geom in a track or wheel."""

    name: str  # added to the body's name
    shape: dict[str, Any]
    """Type, position and size in the track's frame; the z axis of a capsule along a run is the
    belt's direction.
    """
    weight: float  # stiffness relative to a capsule's end [-]
    cored: bool  # whether it has a core, because it may land alone; see `sim.tracks.connect`
    edge: bool = False  # whether it is on an edge of a belt with several lines of contact


def track_parts(hull: Hull, segments: int, anisotropic: bool, lines: Lines) -> tuple[Part, ...]:
    """Geoms of a track in its frame, with `segments` capsules per line along the longest run that
    faces the ground.

    Each run that faces up, and only touches the ground under an overturned robot, is a single
    capsule.
    """
    parts = []
    for k, (y, share) in enumerate(lines):
        is_edge = len(lines) > 1 and k in (0, len(lines) - 1)
        for part in _line(hull, segments, anisotropic):
            x, _, z = part.shape["pos"]
            changed = replace(
                part,
                name=f"{part.name}_{k}" if k else part.name,
                shape=part.shape | {"pos": [x, y, z]},
                weight=part.weight * share,
                edge=is_edge,
            )
            parts.append(changed)
    return tuple(parts)


def wheel_parts(
    wheels: Sequence[Sequence[float]],
    patch: float,
    anisotropic: bool,
    aside: Sequence[float] = (),
) -> tuple[Part, ...]:
    """Geoms of the wheels of a left track without a belt, two per wheel, with the spread of an even
    pressure over a `patch`, and each `aside` from the track's middle [m].
    """
    parts = []
    for i, (x, z, radius) in enumerate(_patch_ends(wheels, patch)):
        part = _wheel(i, x, z, radius, anisotropic)
        outwards = float(aside[i // 2]) if len(aside) else 0.0
        shape = part.shape | {"pos": [x, outwards, z]}
        parts.append(replace(part, shape=shape, weight=part.weight / WHEEL_WEIGHT))
    return tuple(parts)


def _patch_ends(
    wheels: Sequence[Sequence[float]], patch: float
) -> tuple[tuple[float, float, float], ...]:
    """Two circles (x, z, radius) per wheel, with the spread of an even pressure over a `patch`."""
    spread = patch / math.sqrt(12)
    return tuple((x + end * spread, z, radius) for x, z, radius in wheels for end in (-1, 1))


def lines_across(width: float) -> Lines:
    """Lines of contact across a belt of this width [m]: in its middle and, unless the width is 0,
    at its edges.

    Their shares of the load have the second moment of an even pressure, through which the width
    affects turning.
    """
    return ((-width / 2, 1 / 6), (0.0, 2 / 3), (width / 2, 1 / 6)) if width else ((0.0, 1.0),)


def _line(hull: Hull, segments: int, anisotropic: bool) -> tuple[Part, ...]:
    longest = hull.longest_below
    parts = []
    for i, run in enumerate(hull.runs):
        faces_ground = bool(run.outwards[1] < 0)
        count = max(1, round(segments * run.length / longest)) if faces_ground else 1
        # small enough for opposite runs not to overlap
        radius = min(run.radius / 2, _MAX_RUN_RADIUS)
        middle = (run.start + run.end) / 2 - radius * run.outwards
        # angle about y, from z to the belt's direction
        turn = np.arctan2(run.along[0], run.along[1])
        turned = [np.cos(turn / 2), 0.0, np.sin(turn / 2), 0.0]
        for j, (start, end) in enumerate(_chain(run.length, count)):
            x, z = middle + (start + end) / 2 * run.along
            shape = {
                "type": mujoco.mjtGeom.mjGEOM_CAPSULE,
                "pos": [x, 0.0, z],
                "size": [radius, (end - start) / 2, 0.0],
                "quat": turned,
            }
            parts.append(Part(f"run{i}_{j}", shape, 1.0, faces_ground))
    for i, (x, z, radius) in enumerate(hull.wheels.tolist()):
        parts.append(_wheel(i, x, z, radius, anisotropic))
    return tuple(parts)


def _chain(length: float, count: int) -> NDArray[np.float64]:
    """Ends (count, 2) of the capsules along a run, measured from the run's middle [m].

    Together with the wheels at the run's ends, each of which carries half a point's load, the ends
    are spread like an even load: their steps are equal, on a chain shorter than the run, with a
    mean distance of length / 4 from the middle. Each capsule reaches past the beginning of the next
    one, which leaves no gap for an edge. A single capsule is as long as the run.
    """
    if count == 1:
        return np.array([[-length / 2, length / 2]])
    # the contact points, each in the middle of an equal part of the run, then moved inwards
    middles = (np.arange(2 * count) + 0.5) / (2 * count) - 0.5
    ends = middles * length * (1 - WHEEL_WEIGHT / count)

    # a capsule touches at two points; from the second on, it begins at the end of the one before
    first = np.concatenate([ends[:1], ends[1:-2:2]])
    last = np.concatenate([ends[2::2], ends[-1:]])
    return np.stack([first, last], axis=1)


def _wheel(index: int, x: float, z: float, radius: float, anisotropic: bool) -> Part:
    name = f"wheel{index}"
    place = [x, 0.0, z]
    if not anisotropic:
        size = [radius, 0.0, 0.0]
        sphere = {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "pos": place, "size": size}
        return Part(name, sphere, WHEEL_WEIGHT, True)
    # on a plane, only a capsule's contact frame turns with the robot; a capsule touches at both
    # ends
    across = {
        "type": mujoco.mjtGeom.mjGEOM_CAPSULE,
        "pos": place,
        "size": [radius, radius / 100, 0.0],
        "quat": [math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0],
    }
    return Part(name, across, WHEEL_WEIGHT / 2, True)


@dataclass(frozen=True)
class Track(Checked):
    """A track, or a pair of tracks."""

    half_gauge: float
    """Half the distance between the middles of a pair of tracks; for a single track, its distance
    to the left or right of the body's frame, which may be 0 [m].
    """
    hull: Sequence[Sequence[float]]
    """Wheels (x, z, radius) in the body's frame [m]; the belt is their convex hull. A single wheel
    is enough for `contact = "wheels"`.
    """
    preset: str | Preset = "accurate"
    """"accurate" (2 ms), "fast" (4 ms), or a recipe of your own."""
    friction: tuple[float, float] = (0.7, 0.7)
    """Coefficients along and across the belt [-]. They may differ on planes only."""
    name: str = ""
    """Name of the track, by default the body's; a pair is called NAME_left and NAME_right."""
    side: str = "both"
    """Side of the body: "both" for a pair, "left" or "right" for a single track."""
    load: float = checked(1.0, require_positive, 1.0)
    """Share of the robot's weight on these tracks when the robot stands on them [-]."""
    segments: int | None = None
    """Number of capsules along the longest lower run. By default it is the preset's, or larger for
    a robot so wide for its length that exact turns need it; for a single track, such as a
    flipper's, it is two.
    """
    width: float = checked(0.0, require_non_negative)
    """Width of the belts on the ground, with three lines of contact; 0 for a single line in the
    middle [m].
    """
    contact: str = TRACKS
    """Kind of contact: "tracks", or "wheels" for the hull's wheels without a belt, with one speed
    per side.
    """
    patch_length: float = 0.1
    """Length of a wheel's contact with a plane [m]."""
    offset: float = 0.0
    """Distance of a pair's middle to the left of the body's frame [m]."""
    aside: Sequence[float] = ()
    """Distances of the wheels of `hull` from the middle of their track, outwards, for axles of
    different gauges with `contact = "wheels"`; by default 0 [m].
    """

    def __post_init__(self) -> None:
        require(self.side in tuple(_SIDES), "side", self.side, f"one of {', '.join(_SIDES)}")
        (require_positive if self.side == "both" else require_finite)("half_gauge", self.half_gauge)
        most = f"at most {_MAX_HALF_GAUGE:g} m"
        require(abs(self.half_gauge) <= _MAX_HALF_GAUGE, "half_gauge", self.half_gauge, most)
        super().__post_init__()
        require(
            np.shape(self.friction) == (2,),
            "friction",
            self.friction,
            "two coefficients, along and across",
        )
        for value in self.friction:
            require_positive("friction", value, _MAX_FRICTION)
        load_preset(self.preset)
        require_finite("offset", self.offset)
        self._check_aside()
        require(self.contact in (TRACKS, WHEELS), "contact", self.contact, f"{TRACKS} or {WHEELS}")
        self._check_patch()
        Hull.from_wheels(self.chain)
        if self.segments is not None:
            require_whole("segments", self.segments, 1, _MAX_SEGMENTS)
        widest = 2 * self.half_gauge if self.side == "both" else _MAX_HALF_GAUGE
        require(self.width < widest, "width", self.width, f"less than {widest:g} m")

    def _check_aside(self) -> None:
        """Raise InvalidValueError unless there is a distance for each wheel."""
        if not len(self.aside):
            return
        fits = self.contact == WHEELS and len(self.aside) == len(self.hull)
        require(fits, "aside", list(self.aside), f"one for each wheel, with contact = {WHEELS}")
        for distance in self.aside:
            require_within("aside", distance, -_MAX_HALF_GAUGE, _MAX_HALF_GAUGE, "m")

    def _check_patch(self) -> None:
        """Raise InvalidValueError for a patch that is longer than its wheel."""
        if self.contact != WHEELS:
            return
        require_positive("patch_length", self.patch_length)
        wheels = wheel_numbers(self.hull, least=1)
        smallest = 2 * float(wheels[:, 2].min())
        allowed = f"less than the wheels' diameter, {smallest:g} m"
        require(self.patch_length < smallest, "patch_length", self.patch_length, allowed)

    @property
    def sides(self) -> tuple[tuple[str, float], ...]:
        """Suffix of each track's name, and 1 for a left or -1 for a right track."""
        return _SIDES[self.side]

    @property
    def chain(self) -> Sequence[Sequence[float]]:
        """Wheels (x, z, radius) whose convex hull reaches as far as the contact: those of `hull`,
        or for a single wheel both ends of its patch [m].
        """
        if self.contact != WHEELS or len(self.hull) > 1:
            return self.hull
        return _patch_ends(self.hull, self.patch_length)

    @property
    def segment_count(self) -> int:
        """Number of capsules along the longest lower run; even for a pair unless `segments` states
        it.
        """
        if self.segments is not None:
            return self.segments
        if self.side != "both" or len(self.hull) == 1:
            return 2
        points = track_points(
            self.half_gauge, Hull.from_wheels(self.chain).longest_below, load_preset(self.preset)
        )
        return 2 * math.ceil(points / 4)

    def parts(self) -> tuple[Part, ...]:
        """Geoms of each track, in the track's frame."""
        anisotropic = self.friction[0] != self.friction[1]
        if self.contact == WHEELS:
            return wheel_parts(self.hull, self.patch_length, anisotropic, self.aside)
        across = lines_across(self.width)
        return track_parts(Hull.from_wheels(self.hull), self.segment_count, anisotropic, across)
