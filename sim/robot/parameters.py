"""Robot parameters that can be changed without editing the MJCF file, and their TOML files."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from sim.ground.ground import UNLESS_ZERO, Ground
from sim.motors.motor import Drive
from trackslip.arguments import checks_arguments
from trackslip.errors import Checked, checked, require, require_positive, require_within
from trackslip.kinematics import RobotGeometry
from trackslip.skid_theory import Contact, line_contact, wheel_contact

TRACKS, WHEELS = "tracks", "wheels"
"""Kinds of contact with the ground."""
SINK = 0.002
"""Sinkage of the tracks into level ground under the robot's weight, set by the contact recipe for
any robot [m].
"""
TRACK_WIDTH = 0.08
"""Default width of a track, as in files of tracked robots [m]."""
PATCH_LENGTH = 0.1
"""Default length of a wheel's contact with the ground [m]."""
RADIUS_ERROR: Final = 0.0066
"""Relative error of the shipped robot's effective sprocket radius, real / nominal - 1, tuned to the
paper's slips [-].
"""
MAX_RADIUS_ERROR: Final = 0.5
"""Largest magnitude of the radius error [-]."""
_MIN_SIZE = 1e-3  # [m]
_SIZE = require_within, _MIN_SIZE, 10.0, "m"  # allowed lengths
_OFFSET = require_within, -10.0, 10.0, "m"  # allowed coordinates of the centre of mass
_PLATE_HEIGHT = 0.5  # from models/tracked_robot.xml [m]
_MOST_AXLES = 10
_CENTRED = 1e-3  # largest mean of the axles' positions [m]
# largest part of the ground's righting moment that the weight of a leaning robot may cancel [-]
_FIRM = 0.25


@checks_arguments
@dataclass(frozen=True)
class RobotParameters(Checked):
    """Shape, mass and motors of the robot. The defaults are the shipped robot's, in
    models/tracked_robot.xml.
    """

    half_gauge: float = checked(0.168, *_SIZE)
    """Half the distance between the tracks [m]."""
    contact_length: float = checked(0.34, *_SIZE)
    """Length of the tracks' contact with the ground [m]."""
    sprocket_radius: float = checked(0.06, *_SIZE)
    """Nominal radius of the sprockets [m]."""
    radius_error: float = checked(RADIUS_ERROR, require_within, -MAX_RADIUS_ERROR, MAX_RADIUS_ERROR)
    """Relative error of the effective sprocket radius, real / nominal - 1 [-]."""
    mass: float = checked(25.0, require_within, 1e-3, 1e5, "kg")
    """Mass of the robot [kg]."""
    com_x: float = checked(0.0, *_OFFSET)
    """Centre of mass, forward of the centre of the tracks [m]."""
    com_y: float = checked(0.0, *_OFFSET)
    """Centre of mass, to the left of the centre of the tracks [m]."""
    com_height: float = checked(0.12, *_SIZE)
    """Centre of mass above the ground [m]."""
    inertia: tuple[float, ...] = field(default=(), metadata={"stored_unless": ()})
    """Inertia about the centre of mass, xx, yy, zz, xy, xz, yz; empty for the shipped robot's
    inertia, scaled with mass and shape [kg m^2].
    """
    plate_height: float = checked(_PLATE_HEIGHT, *_SIZE, stored_unless=_PLATE_HEIGHT)
    """Height of the plate's centre, and of the scanner, above the ground [m]."""
    looks: str = field(default="", metadata={"stored_unless": ""})
    """Name or file of the tracked robot that is drawn; empty for the shipped robot's looks."""
    contact: str = field(default=TRACKS, metadata={"stored_unless": TRACKS})
    """What touches the ground: "tracks", or "wheels" that turn at one speed per side."""
    axles: tuple[float, ...] = field(default=(), metadata={"stored_unless": ()})
    """Positions of the axles ahead of their mean [m]. The contact extends from the rearmost patch
    to the foremost.
    """
    patch_length: float = field(default=PATCH_LENGTH, metadata={"stored_unless": PATCH_LENGTH})
    """Length of a wheel's contact with the ground [m]."""
    drive: Drive | None = field(default_factory=Drive, metadata={"stored_unless": Drive()})
    """Servos and motors; None for motors of unlimited torque, as in files without `[drive]`. The
    default is the shipped robot's, of 25 kg, whatever the other parameters are.
    """
    track_width: float = checked(TRACK_WIDTH, *_SIZE, stored_unless=TRACK_WIDTH)
    """Width of a track or wheel on soft soil; it has no effect on other ground [m]."""
    radius_split: float = checked(
        0.0, require_within, -MAX_RADIUS_ERROR, MAX_RADIUS_ERROR, **UNLESS_ZERO
    )
    """Half the difference between the sprockets' radius errors, right minus left [-]."""

    def __post_init__(self) -> None:
        self._lay_axles()
        super().__post_init__()
        if self.inertia:
            require_inertia(self.inertia)
        self._require_standing()

    @property
    def geometry(self) -> RobotGeometry:
        """Half gauge and nominal sprocket radius, for the kinematics."""
        return RobotGeometry(self.half_gauge, self.sprocket_radius)

    @property
    def centre_of_mass(self) -> tuple[float, float, float]:
        """Centre of mass, ahead and to the left of the middle of the tracks, and above the ground
        [m].
        """
        return self.com_x, self.com_y, self.com_height

    def with_contact_length(self, length: float) -> RobotParameters:
        """The same robot with another contact length [m]; wheels keep their patch length and move
        apart or together.
        """
        if not self.axles:
            return dataclasses.replace(self, contact_length=length)
        growth = (length - self.patch_length) / (self.contact_length - self.patch_length)
        require(
            growth > 0,
            "contact_length",
            length,
            f"more than that of a patch, {self.patch_length:g} m",
        )
        axles = tuple(growth * x for x in self.axles)
        return dataclasses.replace(self, contact_length=RobotParameters.contact_length, axles=axles)

    def contact_theory(self, along: float, across: float, points: int = 200) -> Contact:
        """The robot's contact, for `skid_theory`, with ground of this friction [-]; at least
        `points` per side.
        """
        rest = (along, across, self.centre_of_mass)
        if not self.axles:
            return line_contact(self.half_gauge, self.contact_length / 2, *rest, points)
        return wheel_contact(
            self.half_gauge, self.axles, self.patch_length, *rest, -(-points // len(self.axles))
        )

    def _lay_axles(self) -> None:
        """Check the kind of contact; sort the axles and derive the contact length from them."""
        require(self.contact in (TRACKS, WHEELS), "contact", self.contact, f"{TRACKS} or {WHEELS}")
        if self.contact == TRACKS:
            for name, default in (("axles", ()), ("patch_length", PATCH_LENGTH)):
                value = getattr(self, name)
                require(value == default, name, value, f'left out without contact = "{WHEELS}"')
            return
        axles = tuple(sorted(self.axles))
        few = 2 <= len(axles) <= _MOST_AXLES and bool(np.isfinite(axles).all())
        require(few, "axles", list(axles), f"2 to {_MOST_AXLES} positions ahead of the middle [m]")
        allowed = (
            f"positions ahead of the middle of all, whose mean is 0 within {1e3 * _CENTRED:g} mm"
        )
        require(abs(np.mean(axles)) <= _CENTRED, "axles", list(axles), allowed)
        require_positive("patch_length", self.patch_length)
        apart = min(float(np.diff(axles).min()), 2 * self.sprocket_radius)
        allowed = f"less than the distance of the axles and the wheels' diameter, {apart:.4g} m"
        require(_MIN_SIZE <= self.patch_length < apart, "patch_length", self.patch_length, allowed)
        span = round(axles[-1] - axles[0] + self.patch_length, 9)
        derived = self.contact_length in (RobotParameters.contact_length, span)
        require(
            derived,
            "contact_length",
            self.contact_length,
            f"left out: the axles make it {span:.4g} m",
        )
        object.__setattr__(self, "axles", axles)
        object.__setattr__(self, "contact_length", span)

    def _require_standing(self) -> None:
        """Raise InvalidValueError if the centre of mass is too high or too far off centre to load
        every contact.
        """
        # mean squares of the coordinates of the ground's springs; they yield by SINK, so a high
        # robot leans further
        spread_x = self.contact_length**2 / 12
        spread_y = self.half_gauge**2
        end = self.contact_length / 2
        if self.axles:
            spread_x = float(np.mean(np.square(self.axles))) + self.patch_length**2 / 12
            end = float(np.abs(self.axles).max()) + self.patch_length / 2
        highest = _FIRM * min(spread_x, spread_y) / SINK
        allowed = f"at most {highest:.4g} m, to stand on {self.contact} of this length and gauge"
        require(self.com_height <= highest, "com_height", self.com_height, allowed)
        leaning = self.com_height * SINK
        reach_x = spread_x / end * (1 - leaning / spread_x)
        reach_y = self.half_gauge * (1 - leaning / spread_y)
        for name, com, reach in (("com_x", self.com_x, reach_x), ("com_y", self.com_y, reach_y)):
            require(abs(com) < reach, name, com, f"between -{reach:.4g} and {reach:.4g} m")
        central = abs(self.com_x) / reach_x + abs(self.com_y) / reach_y < 1
        allowed = f"closer to the centre, to load every point of the {self.contact}"
        require(central, "com_x, com_y", (self.com_x, self.com_y), allowed)


def require_inertia(inertia: Sequence[float]) -> None:
    """Raise InvalidValueError unless the six numbers xx, yy, zz, xy, xz, yz are a rigid body's
    inertia [kg m^2].
    """
    allowed = "six finite numbers xx, yy, zz, xy, xz, yz, as a rigid body has them [kg m^2]"
    are_six = len(inertia) == 6 and bool(np.isfinite(inertia).all())
    require(are_six, "inertia", list(inertia), allowed)
    xx, yy, zz, xy, xz, yz = inertia
    moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    # no moment exceeds the sum of the others
    is_bounded = moments[2] <= moments[:2].sum() * (1 + 1e-9)
    require(moments[0] > 0 and is_bounded, "inertia", list(inertia), allowed)


def robot_file_text(parameters: RobotParameters, ground: Ground, comment: str) -> str:
    """The text of a robot file; `ground` must be level, without patches or changes."""
    given = {}
    for field_ in dataclasses.fields(parameters):
        value = getattr(parameters, field_.name)
        if field_.metadata.get("stored_unless", ...) != value:
            given[field_.name] = value
    given.pop("drive", None)
    if parameters.axles:
        del given["contact_length"]
    driven = ""
    if parameters.drive is not None:
        drive = dataclasses.asdict(parameters.drive)
        motor = _lines(drive.pop("motor"))
        driven = f"\n[drive]\n{_lines(drive)}\n[drive.motor]\n{motor}"
    shear = f"shear = {ground.shear!r}\n" if ground.shear > 0 else ""
    friction = f"along = {ground.along!r}\nacross = {ground.across!r}\n{shear}"
    return f"# {comment}\n{_lines(given)}\n[ground]\n{friction}{driven}"


def ground_file_text(ground: Ground, comment: str) -> str:
    """The text of a ground file; `ground` must be level, without patches or changes."""
    if ground.soil is not None:
        return f"# {comment}\n[soil]\n{_lines(dataclasses.asdict(ground.soil))}"
    friction = _lines({name: getattr(ground, name) for name in ("along", "across", "shear")})
    return f"# {comment}\n{friction}"


def _lines(values: dict[str, Any]) -> str:
    lines = []
    for name, value in values.items():
        shown = list(value) if isinstance(value, tuple) else value
        lines.append(f"{name} = {shown!r}\n")
    return "".join(lines)
