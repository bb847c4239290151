"""What is bolted to a body: a track, or a pair of them, and the contact recipe."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.tracks.hull import Hull
from sim.tracks.parts import Part, lines_across, track_parts, wheel_parts
from sim.tracks.recipe import Preset, load_preset, track_points
from trackslip.errors import (
    Checked,
    checked,
    require,
    require_finite,
    require_non_negative,
    require_positive,
    require_whole,
)

TRACKS, WHEELS = "tracks", "wheels"
"""What touches the ground."""
_SIDES = {"both": (("left", 1.0), ("right", -1.0)), "left": (("", 1.0),), "right": (("", -1.0),)}
_MAX_SEGMENTS = 40
_MAX_HALF_GAUGE = 10.0  # [m]
_MAX_FRICTION = 10.0


@dataclass(frozen=True)
class Track(Checked):
    """A track, or a pair of them."""

    half_gauge: float
    """Half of the distance between the middles of two tracks; of one, its distance to the left or right of the body's
    frame, which may be 0 [m]."""
    hull: Sequence[Sequence[float]]
    """Wheels (x, z, radius) in the body's frame [m]; the belt is their convex hull."""
    preset: str | Preset = "accurate"
    """"accurate" (2 ms), "fast" (4 ms), or a recipe of your own."""
    friction: tuple[float, float] = (0.7, 0.7)
    """Coefficients along and across the belt [-]. They may differ on planes only."""
    name: str = ""
    """Name; two are called NAME_left and NAME_right. By default the body's."""
    side: str = "both"
    """"both", "left" or "right"."""
    load: float = checked(1.0, require_positive, 1.0)
    """Part of the robot's weight that these tracks carry when the robot stands on them [-]."""
    segments: int | None = None
    """Capsules along the longest run below. By default as many as the preset has, more for a robot that is wide for its
    length, which spread the load for turns to be exact; for a single track, such as a flipper's, two."""
    width: float = checked(0.0, require_non_negative)
    """Width of the belts on the ground, which three lines share; 0 for a single line in the middle [m]."""
    contact: str = TRACKS
    """"tracks", or "wheels": those of the hull, which turn at one speed a side and have no belt around them."""
    patch_length: float = 0.1
    """Length of a wheel's contact with a plane [m]."""

    def __post_init__(self) -> None:
        require(self.side in tuple(_SIDES), "side", self.side, f"one of {', '.join(_SIDES)}")
        (require_positive if self.side == "both" else require_finite)("half_gauge", self.half_gauge)
        most = f"at most {_MAX_HALF_GAUGE:g} m"
        require(abs(self.half_gauge) <= _MAX_HALF_GAUGE, "half_gauge", self.half_gauge, most)
        super().__post_init__()
        require(np.shape(self.friction) == (2,), "friction", self.friction, "two coefficients, along and across")
        for value in self.friction:
            require_positive("friction", value, _MAX_FRICTION)
        load_preset(self.preset)
        Hull.from_wheels(self.hull)
        if self.segments is not None:
            require_whole("segments", self.segments, 1, _MAX_SEGMENTS)
        widest = 2 * self.half_gauge if self.side == "both" else _MAX_HALF_GAUGE
        require(self.width < widest, "width", self.width, f"less than {widest:g} m")
        require(self.contact in (TRACKS, WHEELS), "contact", self.contact, f"{TRACKS} or {WHEELS}")
        if self.contact == WHEELS:
            require_positive("patch_length", self.patch_length)
            smallest = 2 * min(radius for _, _, radius in self.hull)
            require(
                self.patch_length < smallest,
                "patch_length",
                self.patch_length,
                f"less than the wheels' diameter, {smallest:g} m",
            )

    @property
    def sides(self) -> tuple[tuple[str, float], ...]:
        """End of the name, and 1 for left or -1 for right, of each track."""
        return _SIDES[self.side]

    @property
    def segment_count(self) -> int:
        """Capsules along the longest run below, an even number for pairs."""
        if self.segments is not None:
            return self.segments
        if self.side != "both":
            return 2
        points = track_points(self.half_gauge, Hull.from_wheels(self.hull).longest_below, load_preset(self.preset))
        return 2 * math.ceil(points / 4)

    def parts(self) -> tuple[Part, ...]:
        """Geoms of each track."""
        anisotropic = self.friction[0] != self.friction[1]
        if self.contact == WHEELS:
            return wheel_parts(self.hull, self.patch_length, anisotropic)
        across = lines_across(self.width)
        return track_parts(Hull.from_wheels(self.hull), self.segment_count, anisotropic, across)
