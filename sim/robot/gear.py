"""Running gear: what a robot stands and drives on, as entries of one list of tracks on its bodies.

Chassis tracks, flippers, front and rear units, a centre belt, rows of wheels and skids are all
entries of this list. `sim.robot.places` finds their places in a model.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from sim.robot.parameters import PATCH_LENGTH, TRACKS, WHEELS
from sim.tracks import Track
from sim.tracks.belts import STANDS
from sim.tracks.hull import Hull, wheel_numbers
from sim.tracks.recipe import Preset
from trackslip.arguments import checks_arguments
from trackslip.errors import (
    Checked,
    checked,
    require,
    require_finite,
    require_non_negative,
    require_positive,
    require_within,
)

Wheels = tuple[tuple[float, float, float], ...]
"""Wheels (x, z, radius) [m]."""
Y = float | tuple[float, float] | None
"""Lateral position of a track, or of a left and a right track [m]; None if it isn't known yet."""

BOTH, LEFT, RIGHT, CENTRE = "both", "left", "right", "centre"
"""Sides of the robot on which an entry has tracks."""
SKID = "skid"
"""Kind of contact of a runner or a ski, which has no belt that turns."""
OWN, NONE = "own", "none"
"""Drives of a belt: a motor of its own, and no motor."""
MOTORS: Final = {LEFT: 0, RIGHT: 1, OWN: 2, NONE: STANDS}
"""Index of a belt's motor by its drive. The motor of a belt with its own runs at the mean speed of
the left and right motors.
"""
_MAX_Y: Final = 10.0  # largest lateral distance from a body's frame [m]
SAME_HEIGHT: Final = 0.005
"""Largest difference in height between wheels that stand on level ground together [m]."""


@dataclass(frozen=True)
class FlipperMotor(Checked):
    """The motor of a hinge that carries flippers."""

    stiffness: float = checked(250.0, require_positive)
    """Stiffness of the motor that a hinge without a motor gets [N m/rad]."""
    damping: float = checked(15.0, require_non_negative)
    """Damping of the added motor [N m s/rad]."""
    torque: float = checked(90.0, require_positive)
    """Largest torque of the added motor, unless the model limits the hinge's torque [N m]."""
    limits: tuple[float, float] | None = None
    """Smallest and largest angle of the hinge, instead of the model's [rad]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.limits is None:
            return
        low, high = self.limits
        require_finite("limits", low)
        require_finite("limits", high)
        require(low < high, "limits", list(self.limits), "the smallest and the largest angle")


@checks_arguments
@dataclass(frozen=True)
class RunningGear(Checked):
    """A track, a pair of tracks, rows of wheels or skids on one body; a table `tracks` in a robot
    file has these fields.
    """

    body: str = ""
    """Name of the body that carries it; by default the chassis."""
    sides: str = BOTH
    """Sides of the robot: both, left, right or centre."""
    y: Y = None
    """Place of the track to the left of the body's frame; for both sides half the gauge, or the
    places of the left and the right track. By default it is read from `wheels` [m].
    """
    wheels: tuple[str, ...] = ()
    """Links of the model that are its wheels: they no longer collide, and are locked."""
    hull: Wheels = ()
    """Wheels (x, z, radius) of a side in the body's frame; by default read from `wheels` [m]."""
    aside: tuple[float, ...] = ()
    """Distances of the wheels of `hull` from `y`, outwards, for axles of different gauges with
    `contact = "wheels"`; by default 0 [m].
    """
    contact: str = TRACKS
    """What touches the ground: tracks, wheels or skid."""
    drive: str = ""
    """Motor that turns it: left, right or own; by default that of its side. A skid has none."""
    patch_length: float = checked(PATCH_LENGTH, require_positive)
    """Length of a wheel's contact with level ground [m]."""
    width: float = checked(0.08, require_positive)
    """Width of the belts, tyres or runners [m]."""
    lines: int = 1
    """Lines of contact across that width: 1 if the width is only drawn, or 3 to resist tipping over
    the edges.
    """
    flipper: FlipperMotor | None = field(default=None, metadata={"stored_unless": None})
    """Motor of the hinge that carries it, if it is a flipper of a table `flippers`."""
    origin: str = field(default="", compare=False, metadata={"stored_unless": ""})
    """Where `y` and `hull` come from."""

    def __post_init__(self) -> None:
        sides = (BOTH, LEFT, RIGHT, CENTRE)
        require(self.sides in sides, "sides", self.sides, "both, left, right or centre")
        kinds = (TRACKS, WHEELS, SKID)
        require(self.contact in kinds, "contact", self.contact, "tracks, wheels or skid")
        drives = ("", *MOTORS)
        require(self.drive in drives, "drive", self.drive, "left, right, own or none")
        if self.contact == SKID:
            allowed = "none for a skid, or left out"
            require(self.drive in ("", NONE), "drive", self.drive, allowed)
        else:
            allowed = "left, right or own, as without a motor wheels stand still and drag: "
            allowed += 'contact = "skid" drags, and wheels that the list leaves out roll'
            require(self.drive != NONE, "drive", self.drive, allowed)
        require(self.lines in (1, 3), "lines", self.lines, "1 or 3")
        self._check_y()
        if self.hull:
            wheel_numbers(self.hull, least=1)
            if not self.has_patches:
                Hull.from_wheels(self.hull)
        if self.aside:
            fits = self.contact == WHEELS and len(self.aside) == len(self.hull)
            require(fits, "aside", list(self.aside), "one for each wheel of `hull`, on wheels")
        super().__post_init__()

    def _check_y(self) -> None:
        if self.y is None:
            return
        if isinstance(self.y, tuple):
            allowed = "one number, as there is one side"
            require(self.sides == BOTH, "y", list(self.y), allowed)
            left, right = self.y
            require(left > right, "y", list(self.y), "that of the left track, then of the right")
        elif self.sides == BOTH:
            require_positive("y", self.y)
        for value in self.y if isinstance(self.y, tuple) else (self.y,):
            require_within("y", value, -_MAX_Y, _MAX_Y, "m")

    @property
    def has_patches(self) -> bool:
        """Whether it touches level ground with a patch per wheel: wheels without a belt, and a
        skid of one wheel, such as a ball. Other gear lies on the ground between its ends.
        """
        return self.contact == WHEELS or (self.contact == SKID and len(self.hull) == 1)

    @property
    def is_complete(self) -> bool:
        """Whether its place and its wheels are known."""
        return self.y is not None and bool(self.hull)

    @property
    def places(self) -> tuple[float, ...]:
        """Lateral place of each of its tracks, left before right [m]."""
        if isinstance(self.y, tuple):
            return self.y
        middle = 0.0 if self.y is None else self.y
        return (middle, -middle) if self.sides == BOTH else (middle,)

    @property
    def drives(self) -> tuple[str, ...]:
        """Drive of each of its tracks: left, right, own or none."""
        sides = (LEFT, RIGHT) if self.sides == BOTH else (self.sides,)
        if self.contact == SKID:
            return (NONE,) * len(sides)
        if self.drive:
            return (self.drive,) * len(sides)
        return tuple(OWN if side == CENTRE else side for side in sides)

    @property
    def contact_length(self) -> float:
        """Length of the contact of one side with level ground, without gaps [m]."""
        if self.has_patches:
            return len(self.hull) * self.patch_length
        return Hull.from_wheels(self.hull).longest_below

    @property
    def contact_width(self) -> float:
        """Width of the contact, 0 if the width is only drawn [m]."""
        return self.width if self.lines == 3 else 0.0

    def track(
        self,
        hull: Wheels,
        preset: str | Preset,
        friction: tuple[float, float],
        name: str = "",
        load: float = 1.0,
        segments: int | None = None,
    ) -> Track:
        """Its tracks, whose wheels in the frame of the tracks are `hull`, with a contact preset and
        friction along and across [-].

        `load` is the share of the robot's weight on them, and `segments` the number of capsules, by
        default chosen by the track.
        """
        left, right = self.places[0], self.places[-1]
        is_pair = self.sides == BOTH
        return Track(
            half_gauge=(left - right) / 2 if is_pair else left,
            hull=hull,
            preset=preset,
            friction=friction,
            name=name,
            side=BOTH if is_pair else LEFT,
            load=load,
            segments=segments,
            width=self.contact_width,
            contact=WHEELS if self.has_patches else TRACKS,
            patch_length=self.patch_length,
            offset=(left + right) / 2 if is_pair else 0.0,
            aside=self.aside,
        )


def levelled(hull: Wheels) -> Wheels:
    """The wheels, with those that are nearly the lowest at the same height, to which tyres and
    springs would bring them.
    """
    lowest = min(z - radius for _, z, radius in hull)
    highest = lowest + SAME_HEIGHT
    return tuple((x, lowest + r if z - r < highest else z, r) for x, z, r in hull)
